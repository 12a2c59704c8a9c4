/** What to know about a part of a recording: late cycles, gaps, invalid samples, faults, events. */

import { el } from "./dom.js";
import { short } from "./format.js";

const MOST = 200;
const NAMES = { late: "late", skipped: "skipped", lost: "missing", invalid: "invalid" };
const INKS = { late: "--warn", skipped: "--warn", lost: "--warn", invalid: "--timing", fault: "--bad" };

/** Return the name of the colour of a kind of mark. */
export function markInk(kind) {
  return INKS[kind] ?? "--calm";
}

/** The marks as a table; a mark leads to its place. */
export class MarkList {
  #span;

  constructor(span) {
    this.#span = span;
    this.body = el("tbody");
    this.note = el("p", { class: "quiet" });
    this.figure = el(
      "section", { class: "chart marks", "aria-label": "Marks" },
      el("strong", {}, "Marks"), this.note,
      el("div", { class: "marks-scroll", tabindex: "0", role: "region", "aria-label": "List of marks" }, el(
        "table", {},
        el("thead", { class: "unseen" }, el("tr", {}, ["Time", "Kind", "What"].map((text) => el("th", { scope: "col" }, text)))),
        this.body,
      )),
    );
  }

  show(marks) {
    this.note.textContent = marks.length ? countText(marks) : "Nothing to note in this part: no late cycle, no gap, no invalid sample, no event.";
    this.body.replaceChildren(...marks.slice(0, MOST).map((mark) => this.#row(mark)));
  }

  #row({ begin_s, end_s, kind, text }) {
    const go = () => this.#span.zoom(1 / 8, (begin_s + end_s) / 2);
    return el(
      "tr", {},
      el("td", {}, el("button", { type: "button", class: "plain", "aria-label": `Zoom to ${short(begin_s)} s`, onclick: go }, `${begin_s.toFixed(3)} s`)),
      el("td", {}, el("span", { class: `mark-kind mark-${kind in INKS ? kind : "event"}` }, NAMES[kind] ?? kind)),
      el("td", {}, text),
    );
  }
}

function countText(marks) {
  return marks.length > MOST ? `The first ${MOST} of ${marks.length}; zoom in for the others.` : `${marks.length} in this part.`;
}
