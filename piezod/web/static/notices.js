/** Messages to people: seen for some seconds, and read by screen readers. */

import { el, withCode } from "./dom.js";

const SHOWN_MS = 8000;
const MOST = 4;

const list = document.getElementById("notices");
const regions = { polite: document.getElementById("polite"), urgent: document.getElementById("urgent") };

/** Let a screen reader say a text: at once if it is urgent, otherwise when it is done. */
export function announce(text, urgent = false) {
  // A text that is said twice is a change only if the region was empty between.
  const region = urgent ? regions.urgent : regions.polite;
  region.textContent = "";
  requestAnimationFrame(() => (region.textContent = text));
}

/**
 * Show a message.
 *
 * @param {string} text What happened, value and limit, what to do.
 * @param {"info"|"good"|"error"} kind An error stays until it is closed.
 */
export function notify(text, kind = "info") {
  const close = () => notice.remove();
  const notice = el(
    "li", { class: `notice ${kind}` },
    el("span", {}, withCode(text)),
    el("button", { type: "button", class: "plain", "aria-label": "Close this message", onclick: close }, "×"),
  );
  list.append(notice);
  while (list.children.length > MOST) list.firstChild.remove();
  if (kind !== "error") setTimeout(close, SHOWN_MS);
  announce(text, kind === "error");
}
