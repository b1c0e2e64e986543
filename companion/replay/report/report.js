"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const video = document.getElementById("video");
const words = {fit: "FIT TO LAND", unfit: "NOT FIT", unknown: "UNKNOWN"};
const shades = {fit: "rgba(0,150,60,.16)", unfit: "rgba(210,30,50,.15)", unknown: "rgba(120,120,120,.13)"};
const inks = {fit: "#00a046", unfit: "#e0243f", unknown: "#8a8a8a"};
const lineColours = ["#1f6fd6", "#d9731f"];
const end = Math.max(data.duration, 0.1);
let from = 0, to = end, cursor = 0;

function theme() {
  const style = getComputedStyle(document.documentElement);
  return {fg: style.getPropertyValue("--fg"), line: style.getPropertyValue("--line"), card: style.getPropertyValue("--card")};
}

function indexAt(time) {  // of the last frame at or before the time
  let low = 0, high = data.times.length;
  while (low < high) { const mid = (low + high) >> 1; if (data.times[mid] <= time) low = mid + 1; else high = mid; }
  return Math.max(0, low - 1);
}

function spanAt(time) { return data.spans.filter(s => s.start <= time).pop(); }

function fitted(canvas, height) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
  canvas.style.height = height + "px";
  canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [c, width, height];
}

function steps(low, high, most) {
  const raw = (high - low) / most, power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = [1, 2, 5, 10].map(f => f * power).find(s => s >= raw);
  const found = [];
  for (let v = Math.ceil(low / step) * step; v <= high + step * 1e-6; v += step) found.push(v);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

const left = 52, right = 8, top_ = 6, bottom = 22;
const x = (time, width) => left + (time - from) / (to - from) * (width - left - right);

function range(plot) {
  const seen = [], first = indexAt(from), last = indexAt(to);
  for (const line of plot.lines) for (let i = first; i <= last; i++) if (line.values[i] !== null) seen.push(line.values[i]);
  seen.sort((a, b) => a - b);
  let low = seen.length ? seen[Math.floor(seen.length * .002)] : 0;
  let high = seen.length ? seen[Math.ceil(seen.length * .998) - 1] : 1;
  if (plot.limit !== null) high = Math.max(high, plot.limit * 1.3);
  if (plot.lines.length === 1) low = Math.min(low, 0);
  const room = (high - low) * .08 || 1;
  return [low === 0 ? 0 : low - room, high + room];
}

function draw(plot) {
  const canvas = document.getElementById("plot-" + plot.name), t = theme();
  const [c, width, height] = fitted(canvas, 150);
  const [low, high] = range(plot), y = v => top_ + (high - v) / (high - low) * (height - top_ - bottom);
  c.clearRect(0, 0, width, height);
  c.save();
  c.beginPath(); c.rect(left, top_, width - left - right, height - top_ - bottom); c.clip();
  for (const s of data.spans) { c.fillStyle = shades[s.verdict]; c.fillRect(x(s.start, width), 0, x(s.end, width) - x(s.start, width), height); }
  c.restore();
  c.font = "12px system-ui, sans-serif"; c.fillStyle = t.fg; c.strokeStyle = t.line; c.lineWidth = .5;
  const [ys, digits] = steps(low, high, 4);
  c.textAlign = "right"; c.textBaseline = "middle";
  for (const v of ys) { c.beginPath(); c.moveTo(left, y(v)); c.lineTo(width - right, y(v)); c.stroke(); c.fillText(v.toFixed(digits), left - 6, y(v)); }
  const [xs, places] = steps(from, to, Math.max(3, width / 130));
  c.textAlign = "center"; c.textBaseline = "top";
  for (const v of xs) c.fillText(v.toFixed(places) + " s", Math.min(x(v, width), width - 20), height - bottom + 6);
  c.save();
  c.beginPath(); c.rect(left, top_, width - left - right, height - top_ - bottom); c.clip();
  const first = Math.max(0, indexAt(from) - 1), last = Math.min(data.times.length - 1, indexAt(to) + 1);
  if (plot.std) {
    c.fillStyle = "rgba(31,111,214,.25)";
    const v = plot.lines[0].values;
    for (let i = first; i < last; i++) {
      if (v[i] === null || v[i + 1] === null || plot.std[i] === null || plot.std[i + 1] === null) continue;
      c.beginPath(); c.moveTo(x(data.times[i], width), y(v[i] - 2 * plot.std[i])); c.lineTo(x(data.times[i], width), y(v[i] + 2 * plot.std[i]));
      c.lineTo(x(data.times[i + 1], width), y(v[i + 1] + 2 * plot.std[i + 1])); c.lineTo(x(data.times[i + 1], width), y(v[i + 1] - 2 * plot.std[i + 1]));
      c.fill();
    }
  }
  plot.lines.forEach((line, k) => {
    c.strokeStyle = lineColours[k]; c.lineWidth = 1.8; c.beginPath();
    let open = false;
    for (let i = first; i <= last; i++) {
      if (line.values[i] === null) { open = false; continue; }
      const px = x(data.times[i], width), py = y(line.values[i]);
      if (open) c.lineTo(px, py); else { c.moveTo(px, py); c.lineTo(px + .01, py); }
      open = true;
    }
    c.stroke();
  });
  if (plot.limit !== null) { c.strokeStyle = "#d1243c"; c.lineWidth = 1.6; c.setLineDash([7, 5]); c.beginPath(); c.moveTo(left, y(plot.limit)); c.lineTo(width, y(plot.limit)); c.stroke(); c.setLineDash([]); }
  for (const at of data.requests) { c.fillStyle = t.fg; c.fillRect(x(at, width) - 1, 0, 2.5, height); }
  c.fillStyle = "#8a5cf0"; c.fillRect(x(cursor, width) - 1, 0, 2, height);
  c.restore();
}

function legends() {
  for (const plot of data.plots) {
    const box = document.getElementById("legend-" + plot.name);
    const add = (colour, text) => { const i = document.createElement("i"); i.style.background = colour; box.append(i, text); };
    if (plot.lines.length > 1) plot.lines.forEach((line, k) => add(lineColours[k], line.label));
    if (plot.std) add("rgba(31,111,214,.4)", "± 2 sigma");
    if (plot.limit !== null) add("#d1243c", "limit " + plot.limit);
    if (data.requests.length && plot === data.plots[0]) add("var(--fg)", "landing requested");
  }
}

const decoded = new Map();
function cells(map, key, type) {
  const id = map[key];
  if (!decoded.has(id)) decoded.set(id, new type(Uint8Array.from(atob(id), ch => ch.charCodeAt(0)).buffer));
  return decoded.get(id);
}

function drawMap() {
  const canvas = document.getElementById("map");
  if (!canvas) return;
  const shown = data.maps.filter(m => m.time <= cursor).pop() || data.maps[0];
  const grid = (data.maps.filter(m => m.map && m.time <= cursor).pop() || {}).map;
  let ns = data.path.map(p => p[1]), es = data.path.map(p => p[2]);
  for (const p of data.places.chosen) if (p[1] !== null) { ns.push(p[1]); es.push(p[2]); }
  for (const m of data.maps) { ns.push(m.north_m); es.push(m.east_m); if (m.map) {
    ns.push(m.map.north0_m, m.map.north0_m + m.map.rows * m.map.cell_m); es.push(m.map.east0_m, m.map.east0_m + m.map.columns * m.map.cell_m); } }
  const n0 = Math.min(...ns) - 1, n1 = Math.max(...ns) + 1, e0 = Math.min(...es) - 1, e1 = Math.max(...es) + 1;
  const room = canvas.clientWidth, scale = Math.min((room - 20) / (e1 - e0), 460 / (n1 - n0));
  const [c, width, height] = fitted(canvas, Math.max(140, (n1 - n0) * scale)), t = theme();
  const px = e => (width - (e1 - e0) * scale) / 2 + (e - e0) * scale, py = n => height / 2 - (n - (n0 + n1) / 2) * scale;
  c.clearRect(0, 0, width, height);
  if (grid) {
    const state = cells(grid, "state", Uint8Array), heights = cells(grid, "height", Int16Array);
    const size = grid.cell_m * scale + .6;
    for (let i = 0; i < grid.rows; i++) for (let j = 0; j < grid.columns; j++) {
      const k = i * grid.columns + j;
      if (heights[k] === -32768 && state[k] === 0) continue;
      const light = 45 + Math.max(-20, Math.min(20, heights[k] / 40));
      c.fillStyle = ["hsl(0 0% " + light + "%)", "hsl(35 75% " + light + "%)", "hsl(140 60% " + light + "%)",
        "hsl(350 70% " + light + "%)"][state[k]] || "gray";
      c.fillRect(px(grid.east0_m + j * grid.cell_m), py(grid.north0_m + (i + 1) * grid.cell_m), size, size);
    }
  }
  c.lineWidth = 4; c.lineCap = "round";
  for (let i = 1; i < data.path.length; i++) {
    const a = data.path[i - 1], b = data.path[i], s = spanAt(b[0]);
    c.strokeStyle = inks[s ? s.verdict : "unknown"]; c.beginPath(); c.moveTo(px(a[2]), py(a[1])); c.lineTo(px(b[2]), py(b[1])); c.stroke();
  }
  const ring = (n, e, r, colour, wide) => { c.strokeStyle = colour; c.lineWidth = wide; c.beginPath(); c.arc(px(e), py(n), r, 0, 7); c.stroke(); };
  const place = time => data.path.filter(p => p[0] <= time).pop() || data.path[0];
  for (const at of data.requests) { const p = place(at); if (p) ring(p[1], p[2], 9, t.fg, 3); }
  if (shown && grid) for (const s of shown.spots || []) ring(shown.north_m + s.north_m, shown.east_m + s.east_m, s.radius_m * scale, inks.fit, 2);
  const chosen = data.places.chosen.filter(p => p[0] <= cursor).pop(), vehicle = place(cursor);
  if (chosen && chosen[1] !== null && vehicle) {
    // the map's own axes, where it is shown, lie where the vehicle was in them
    const then = shown && grid ? place(shown.time) : [0, 0, 0], dn = shown && grid ? shown.north_m - then[1] : 0, de = shown && grid ? shown.east_m - then[2] : 0;
    ring(chosen[1] + dn, chosen[2] + de, Math.max(5, (data.places.radius_m || 0) * scale), "#d13bb5", 3);
    c.lineWidth = 2; c.beginPath(); c.moveTo(px(vehicle[2] + de), py(vehicle[1] + dn)); c.lineTo(px(chosen[2] + de), py(chosen[1] + dn)); c.stroke();
  }
  const here = shown && grid ? [0, shown.north_m, shown.east_m] : place(cursor);
  if (here) { c.fillStyle = "#8a5cf0"; c.beginPath(); c.arc(px(here[2]), py(here[1]), 6, 0, 7); c.fill(); }
  const metres = [1, 2, 5, 10, 20, 50, 100].find(m => m * scale > 50) || 100;
  c.strokeStyle = c.fillStyle = t.fg; c.lineWidth = 2; c.font = "13px system-ui, sans-serif"; c.textAlign = "left";
  c.beginPath(); c.moveTo(10, height - 10); c.lineTo(10 + metres * scale, height - 10); c.stroke(); c.fillText(metres + " m", 12, height - 16);
  c.fillText("N ↑", 12, 18);
}

function tell() {
  const box = document.getElementById("cursor");
  if (!box || !data.times.length) return;
  const s = spanAt(cursor), reasons = ((s && s.steps.filter(step => step[0] <= cursor).pop()) || [0, []])[1], i = indexAt(cursor), mode = data.modes.filter(m => m[0] <= cursor).pop();
  const value = (name, digits, unit) => { const v = data.plots.find(p => p.name === name).lines[0].values[i]; return v === null ? "unknown" : v.toFixed(digits) + unit; };
  box.textContent = `${cursor.toFixed(1)} s: ${s ? words[s.verdict] : "UNKNOWN"}` + (reasons.length ? ` (${reasons.join("; ")})` : "") +
    `. Inclination ${value("inclination", 1, "°")}, roughness ${value("roughness", 4, "")}, distance ${value("height", 1, " m")}` + (mode ? `, mode ${mode[1]}` : "") + ".";
}

let asked = false;
function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; data.plots.forEach(draw); drawMap(); tell(); });
}

function show(a, b) {
  const span = Math.max(.2, Math.min(end, b - a));
  from = Math.max(0, Math.min(end - span, a)); to = from + span;
  redraw();
}

function zoom(factor, about) { show(about - (about - from) * factor, about + (to - about) * factor); }

function go(time) {
  cursor = Math.max(0, Math.min(end, time));
  if (video) video.currentTime = (indexAt(cursor) + .5) / data.fps;
  redraw();
}

const acts = {in: () => zoom(.5, (from + to) / 2), out: () => zoom(2, (from + to) / 2), all: () => show(0, end),
  back: () => show(from - (to - from) / 3, to - (to - from) / 3), on: () => show(from + (to - from) / 3, to + (to - from) / 3)};
document.querySelectorAll("[data-zoom]").forEach(b => b.addEventListener("click", acts[b.dataset.zoom]));
for (const plot of data.plots) {
  const canvas = document.getElementById("plot-" + plot.name);
  const time = event => from + (event.clientX - canvas.getBoundingClientRect().left - left) / (canvas.clientWidth - left - right) * (to - from);
  let start = null;
  canvas.addEventListener("wheel", e => { e.preventDefault(); zoom(e.deltaY > 0 ? 1.25 : .8, time(e)); }, {passive: false});
  canvas.addEventListener("pointerdown", e => { start = [e.clientX, from, to, false]; canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener("pointermove", e => {
    if (!start || Math.abs(e.clientX - start[0]) < 4 && !start[3]) return;
    start[3] = true;
    const by = (start[0] - e.clientX) / (canvas.clientWidth - left - right) * (start[2] - start[1]);
    show(start[1] + by, start[2] + by);
  });
  canvas.addEventListener("pointerup", e => { if (start && !start[3]) go(time(e)); start = null; });
  canvas.addEventListener("dblclick", acts.all);
  canvas.addEventListener("keydown", e => {
    const act = {"+": acts.in, "=": acts.in, "-": acts.out, "0": acts.all, ArrowLeft: acts.back, ArrowRight: acts.on}[e.key];
    if (act) { e.preventDefault(); act(); }
  });
}
if (video) video.addEventListener("timeupdate", () => {
  const i = Math.min(data.times.length - 1, Math.floor(video.currentTime * data.fps));
  if (i >= 0) { cursor = data.times[i]; redraw(); }
});
window.addEventListener("resize", redraw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
legends();
redraw();
