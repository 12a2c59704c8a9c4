/** Dark and light: as the system has it, until the person chooses. */

const KEY = "piezod-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const handlers = new Set();

/** Return `dark` or `light`: what is shown now. */
export function shownTheme() {
  return document.documentElement.dataset.theme;
}

/** Call a handler after each change of the colours; return a function that ends this. */
export function onTheme(handler) {
  handlers.add(handler);
  return () => handlers.delete(handler);
}

/** Return the value of a colour of the theme, as `--ink`. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Show the theme, and let a button switch it. */
export function startTheme(button) {
  const show = () => {
    const theme = localStorage.getItem(KEY) ?? (dark.matches ? "dark" : "light");
    document.documentElement.dataset.theme = theme;
    button.setAttribute("aria-pressed", String(theme === "dark"));
    for (const handler of handlers) handler();
  };
  button.addEventListener("click", () => {
    localStorage.setItem(KEY, shownTheme() === "dark" ? "light" : "dark");
    show();
  });
  dark.addEventListener("change", show);
  show();
}
