/** The faults of a stage with their remedies. A new one is read out at once. */

import { el, withCode } from "./dom.js";
import { announce } from "./notices.js";

const SHOWN_MS = 10_000; // a fault that ends by itself stays so long: people read slower than cycles

/** Return the faults that stay until a person acts, large, above everything else. */
export function bannerPanel() {
  const element = el("ul", { class: "faults banner", "aria-label": "Faults that are latched", hidden: true });
  let shown = "";
  let known = [];
  const show = ({ up, status }) => {
    const faults = (up ? status?.faults ?? [] : []).filter(({ latched }) => latched);
    const now = faults.map(({ id, present }) => `${id} ${present}`).join();
    if (now === shown) return;
    shown = now;
    element.hidden = !faults.length;
    element.replaceChildren(...faults.map((fault) => faultLine(fault, fault.present ? "present" : "gone, latched until reset")));
    const fresh = faults.filter(({ id }) => !known.includes(id));
    known = faults.map(({ id }) => id);
    if (fresh.length) announce(fresh.map(({ id, name, remedy }) => `Fault ${id}, ${name}: ${remedy}.`).join(" "), true);
  };
  return { element, show };
}

/** Return all other faults. */
export function faultsPanel() {
  const list = el("ul", { class: "faults" });
  const element = el("section", { class: "panel fault-panel" }, el("h2", {}, "Warnings"), list);
  const seen = new Map(); // id: the fault, and when it was present last
  let shown = null;
  const show = ({ up, status }) => {
    const now_ms = performance.now();
    for (const fault of up ? status?.faults ?? [] : []) seen.set(fault.id, { fault, at_ms: now_ms });
    for (const [id, { fault, at_ms }] of seen) if (fault.latched || now_ms - at_ms > SHOWN_MS) seen.delete(id);
    const lines = [...seen.values()].map(({ fault, at_ms }) => ({ fault, now: at_ms === now_ms ? "present" : "over" }));
    const key = lines.map(({ fault, now }) => fault.id + now).join();
    if (key === shown) return;
    shown = key;
    list.replaceChildren(...(lines.length ? lines.map(({ fault, now }) => faultLine(fault, now)) : [el("li", { class: "quiet" }, "none")]));
  };
  return { element, show };
}

function faultLine({ id, name, latched, remedy }, now) {
  return el(
    "li", { class: latched ? "fault" : "fault mild" },
    el("strong", { class: "fault-id" }, id), el("span", {}, name), el("span", { class: "remedy" }, "What to do: ", withCode(remedy)),
    el("span", { class: "fault-now" }, now),
  );
}
