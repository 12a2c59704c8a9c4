/** All stages of this machine, each as a card that leads to its page. */

import { el } from "./dom.js";
import { clockTime, microns } from "./format.js";

/** Show the stages in an element; return a function that ends it. */
export function mount(element, context) {
  const list = el("ul", { class: "cards" });
  const empty = el(
    "p", { class: "empty" },
    "No stage runs on this machine. Start one with ", el("code", {}, "piezod run CONFIG"), "; it appears here by itself.",
  );
  element.append(el("h1", {}, "Stages of this machine"), list, empty);
  const show = () => {
    const stages = context.stages();
    empty.hidden = stages.length > 0;
    list.replaceChildren(...stages.map(card));
  };
  show();
  return context.onStage(show);
}

function card({ stage, up, since, status }) {
  const state = up ? status?.state ?? "…" : "away";
  return el(
    "li", {},
    el(
      "a", { class: "card", href: `#/stage/${encodeURIComponent(stage)}` },
      el("strong", {}, stage),
      el("span", { class: "badge", "data-state": state }, state),
      el("span", { class: "quiet" }, status?.title ?? (up ? "" : `away since ${clockTime(since)}`)),
      Object.entries(status?.axes ?? {}).map(([name, axis]) => el(
        "span", { class: "numbers" }, `${name} ${microns(axis.position_um)} ${axis.unit ?? "µm"} · ${axis.mode}`,
      )),
      (status?.faults ?? []).map((fault) => el("span", { class: "fault-line" }, `${fault.id} ${fault.name}`)),
    ),
  );
}
