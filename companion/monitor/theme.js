// Light, dark or sunlight: the system's wish until a button says otherwise; kept in this browser.
(() => {
  const names = ["light", "dark", "sunlight"], key = "landslope-theme";
  const wished = () => matchMedia("(prefers-contrast: more)").matches ? "sunlight"
    : matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  const read = () => { try { return localStorage.getItem(key); } catch { return null; } };
  const apply = () => {
    const chosen = read(), theme = names.includes(chosen) ? chosen : wished();
    document.documentElement.dataset.theme = theme;
    const button = document.getElementById("theme");
    if (button) button.textContent = "theme: " + theme + (names.includes(chosen) ? "" : " (system)");
  };
  window.landslopeTheme = () => {
    const now = document.documentElement.dataset.theme, next = names[(names.indexOf(now) + 1) % names.length];
    try { if (next === wished()) localStorage.removeItem(key); else localStorage.setItem(key, next); } catch { /* private window */ }
    document.documentElement.dataset.theme = next;
    apply();
  };
  for (const query of ["(prefers-color-scheme: dark)", "(prefers-contrast: more)"]) matchMedia(query).addEventListener("change", apply);
  apply();
  new MutationObserver((_, seen) => { if (document.getElementById("theme")) { apply(); seen.disconnect(); } })
    .observe(document.documentElement, {childList: true, subtree: true});
})();
