// The ground map as a mesh with relief colours, the vehicle above it. Data come as attributes of the canvas.
(() => {
  const GLIDE_MS = 500, STEP_MS = 50, RELIEF_M = 0.3, NONE = -32768, ARM_M = 0.3;
  const LOW = [38, 92, 214], LEVEL = [214, 214, 200], HIGH = [222, 84, 16];
  const look = {turn: 0.5, tilt: 0.62};
  let mesh = null, meshText = "", poseText = "", goal = null, from = null, began = 0, timer = 0;

  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const read = text => {
    const m = JSON.parse(text), raw = bytes(m.height);
    return {...m, z: new Int16Array(raw.buffer, 0, m.rows * m.columns)};
  };
  // Between two messages the vehicle glides: they come twice a second.
  const place = () => {
    if (!goal) return null;
    const s = from ? Math.min(1, (performance.now() - began) / GLIDE_MS) : 1;
    const mix = key => from ? from[key] + s * (goal[key] - from[key]) : goal[key];
    return {...goal, n: mix("n"), e: mix("e"), up: mix("up"), arrived: s >= 1};
  };
  const hue = (metres, light) => {
    const t = Math.max(-1, Math.min(1, metres / RELIEF_M)), end = t < 0 ? LOW : HIGH;
    return `rgb(${LEVEL.map((c, k) => Math.round(light * (c + Math.abs(t) * (end[k] - c)))).join(",")})`;
  };
  const order = (count, forwards) => Array.from({length: count}, (_, k) => forwards ? k : count - 1 - k);

  function draw() {
    timer = 0;
    const canvas = document.getElementById("ground3d"), at = place();
    if (!canvas || !at || !canvas.clientWidth) return;
    const ratio = Math.min(2, devicePixelRatio || 1), width = canvas.clientWidth, height = Math.round(width * 0.72);
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio); canvas.style.height = height + "px";
    }
    const g = canvas.getContext("2d"), css = getComputedStyle(canvas), colour = name => css.getPropertyValue(name).trim();
    g.setTransform(ratio, 0, 0, ratio, 0, 0); g.clearRect(0, 0, width, height);
    const ct = Math.cos(look.turn), st = Math.sin(look.turn), ci = Math.sin(look.tilt), si = Math.cos(look.tilt);
    const level = mesh ? mesh.middle : at.up - 2, above = Math.max(1, at.up - level);
    const reach = mesh ? Math.max(mesh.rows, mesh.columns) * mesh.cell / 2 : 3;
    const far = 2.6 * Math.max(reach, above), zoom = 0.72 * Math.min(width, 1.4 * height) / Math.max(reach * 1.2, above) * far / 2;
    const centre = level + 0.35 * above;
    // north, east, up -> right, down, depth
    const project = (n, e, up) => {
      const dn = n - at.n, de = e - at.e, dz = up - centre;
      const x = de * ct - dn * st, y = de * st + dn * ct, depth = far + y * si - dz * ci;
      const s = zoom / Math.max(0.2, depth);
      return [width / 2 + x * s, height / 2 - (y * ci + dz * si) * s, depth];
    };
    const line = (points, stroke, size, dash) => {
      g.beginPath(); points.forEach((p, k) => k ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1]));
      g.setLineDash(dash || []); g.strokeStyle = stroke; g.lineWidth = size; g.stroke(); g.setLineDash([]);
    };
    // height of the ground, null where it is not known
    const known = (n, e) => {
      if (!mesh) return null;
      const i = Math.round((n - mesh.n0) / mesh.cell - 0.5), j = Math.round((e - mesh.e0) / mesh.cell - 0.5);
      if (i < 0 || j < 0 || i >= mesh.rows || j >= mesh.columns) return null;
      const z = mesh.z[i * mesh.columns + j];
      return z === NONE ? null : z / 1000;
    };
    const below = known(at.n, at.e) ?? level;
    const around = (n, e, r) => {
      const found = [[0, 0], [r, 0], [-r, 0], [0, r], [0, -r]].map(([a, b]) => known(n + a, e + b)).filter(z => z !== null);
      return found.length ? found.reduce((a, b) => a + b) / found.length : below;
    };
    const ring = (n, e, r, up, stroke, size, dash) => line(Array.from({length: 33}, (_, k) => {
      const a = k * Math.PI / 16, pn = n + r * Math.cos(a), pe = e + r * Math.sin(a);
      return project(pn, pe, up);
    }), stroke, size, dash);
    let cells = 0;
    if (mesh) {
      const {rows, columns, cell, z} = mesh, corner = new Float64Array(rows * columns * 2);
      for (let i = 0; i < rows; i++) for (let j = 0; j < columns; j++) {
        const k = i * columns + j;
        if (z[k] === NONE) continue;
        const p = project(mesh.n0 + (i + 0.5) * cell, mesh.e0 + (j + 0.5) * cell, z[k] / 1000);
        corner[2 * k] = p[0]; corner[2 * k + 1] = p[1];
      }
      // the far ones first
      for (const i of order(rows - 1, ct < 0)) for (const j of order(columns - 1, st < 0)) {
        const k = i * columns + j, ks = [k, k + 1, k + columns + 1, k + columns].filter(q => z[q] !== NONE);
        if (ks.length < 3) continue;
        const rise = (a, b) => z[a] === NONE || z[b] === NONE ? 0 : (z[b] - z[a]) / 1000 / cell;
        const dn = rise(k, k + columns), de = rise(k, k + 1);
        const light = Math.max(0.45, Math.min(1.1, 0.95 + 0.35 * (dn * 0.7 - de * 0.7)));
        const mean = ks.reduce((sum, q) => sum + z[q], 0) / ks.length / 1000;
        g.fillStyle = g.strokeStyle = hue(mean - level, light); g.lineWidth = 0.7;
        g.beginPath(); ks.forEach((q, m) => m ? g.lineTo(corner[2 * q], corner[2 * q + 1]) : g.moveTo(corner[2 * q], corner[2 * q + 1]));
        g.closePath(); g.fill(); g.stroke(); cells++;
      }
    }
    const disc = ([n, e, r], stroke, dash) => ring(at.n + n, at.e + e, r, around(at.n + n, at.e + e, r) + 0.02, stroke, 3, dash);
    for (const s of at.spots) disc(s, colour("--good"));
    if (at.disc) disc(at.disc, colour("--fg"), [6, 4]);
    // the vehicle, level: its heading is not in the messages
    const fg = colour("--fg"), body = project(at.n, at.e, at.up);
    line([body, project(at.n, at.e, below)], colour("--value"), 2, [4, 4]);
    for (const [a, b] of [[1, 1], [1, -1], [-1, -1], [-1, 1]]) {
      line([body, project(at.n + a * ARM_M, at.e + b * ARM_M, at.up)], fg, 4);
      ring(at.n + a * ARM_M, at.e + b * ARM_M, 0.6 * ARM_M, at.up, fg, 2);
    }
    const north = [project(at.n + reach * 1.06, at.e, level), project(at.n + reach * 1.24, at.e, level)];
    line(north, colour("--value"), 4); g.fillStyle = fg; g.font = "bold 16px system-ui, sans-serif"; g.textAlign = "center";
    const tip = project(at.n + reach * 1.38, at.e, level); g.fillText("N", tip[0], tip[1] + 6);
    g.textAlign = "left"; g.fillText(`${(at.up - below).toFixed(1)} m above the ground`, 8, 20);
    canvas.dataset.cells = cells; canvas.dataset.drawn = Number(canvas.dataset.drawn || 0) + 1;
    if (!at.arrived) timer = setTimeout(draw, STEP_MS);
  }
  const ask = () => { if (!timer) timer = setTimeout(draw, 0); };

  function take() {
    const canvas = document.getElementById("ground3d");
    if (!canvas) return;
    if (!canvas.dataset.bound) {
      canvas.dataset.bound = "1";
      let drag = null;
      canvas.addEventListener("pointerdown", e => { drag = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener("pointermove", e => { if (drag) { turn((e.clientX - drag[0]) / 120, (e.clientY - drag[1]) / 200); drag = [e.clientX, e.clientY]; } });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { drag = null; });
      canvas.addEventListener("keydown", e => {
        const way = {ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08]}[e.key];
        if (way) { turn(...way); e.preventDefault(); }
      });
      new ResizeObserver(ask).observe(canvas);
    }
    const map = canvas.dataset.map || "", pose = canvas.dataset.pose || "";
    if (map !== meshText) { meshText = map; mesh = map ? read(map) : null; }
    if (pose !== poseText) {
      poseText = pose;
      const next = pose ? JSON.parse(pose) : null, now = place();
      // a place that jumps is in other axes: no gliding there
      from = now && next && Math.hypot(next.n - now.n, next.e - now.e) < 3 ? now : null;
      goal = next; began = performance.now();
    }
    ask();
  }
  function turn(by, up) { look.turn -= by; look.tilt = Math.max(0.2, Math.min(1.5, look.tilt + up)); ask(); }

  new MutationObserver(take).observe(document.documentElement, {childList: true, subtree: true, attributes: true, attributeFilter: ["data-map", "data-pose", "data-theme"]});
})();
