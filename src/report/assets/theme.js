// Light or dark: as the system says, until the button says otherwise.

const darkQuery = matchMedia("(prefers-color-scheme: dark)");
const themeListeners = [];
let chosenTheme = stored("coact-theme");

/** Pages from disk may have no storage. */
function stored(key) {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

function store(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    // It holds for this page alone then.
  }
}

function theme() {
  if (chosenTheme === "light" || chosenTheme === "dark") return chosenTheme;
  return darkQuery.matches ? "dark" : "light";
}

function applyTheme() {
  document.documentElement.dataset.theme = theme();
  const other = theme() === "dark" ? "light" : "dark";
  byId("theme").textContent = other === "dark" ? "Dark" : "Light";
  byId("theme").setAttribute("aria-label", `Switch to ${other} colours`);
  for (const listener of themeListeners) listener();
}

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** Colours of composite actions, in turn. */
const SEGMENT_COLOURS = 6;

function segmentColour(segment) {
  return colour(`s${segment % SEGMENT_COLOURS}`);
}

function startTheme() {
  byId("theme").addEventListener("click", () => {
    chosenTheme = theme() === "dark" ? "light" : "dark";
    store("coact-theme", chosenTheme);
    applyTheme();
  });
  darkQuery.addEventListener("change", applyTheme);
  applyTheme();
}
