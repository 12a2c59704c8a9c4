/** The span of a recording that is shown: zoom and pan, within the recording. */

import { el } from "./dom.js";

const SHORTEST_S = 1e-3;

/** A span; handlers of `onChange` are called after each change. */
export class Span {
  #handlers = [];

  constructor(first_s, last_s) {
    Object.assign(this, { first_s, last_s, begin_s: first_s, end_s: last_s });
  }

  onChange(handler) {
    this.#handlers.push(handler);
  }

  /** Show from one instant to another one. */
  set(begin_s, end_s) {
    const length_s = Math.min(Math.max(end_s - begin_s, SHORTEST_S), this.last_s - this.first_s);
    const middle_s = (begin_s + end_s) / 2;
    this.begin_s = Math.min(Math.max(middle_s - length_s / 2, this.first_s), this.last_s - length_s);
    this.end_s = this.begin_s + length_s;
    for (const handler of this.#handlers) handler();
  }

  /** Make the span longer or shorter by a factor; an instant keeps its place. */
  zoom(factor, about_s = (this.begin_s + this.end_s) / 2) {
    this.set(about_s + (this.begin_s - about_s) * factor, about_s + (this.end_s - about_s) * factor);
  }

  /** Move the span by a share of its length. */
  pan(share) {
    const by_s = share * (this.end_s - this.begin_s);
    this.set(this.begin_s + by_s, this.end_s + by_s);
  }

  all() {
    this.set(this.first_s, this.last_s);
  }

  /** The recording has grown; a span that reached its end grows too. */
  extend(last_s) {
    const all = this.begin_s <= this.first_s && this.end_s >= this.last_s;
    this.last_s = last_s;
    if (all) this.all();
  }

  /** Return buttons that do all of it, for the keyboard. */
  buttons() {
    const button = (text, label, action) => el("button", { type: "button", "aria-label": label, title: label, onclick: action }, text);
    return [
      button("◀", "Earlier", () => this.pan(-0.5)),
      button("▶", "Later", () => this.pan(0.5)),
      button("+", "Zoom in", () => this.zoom(0.5)),
      button("−", "Zoom out", () => this.zoom(2)),
      button("All", "Show all", () => this.all()),
    ];
  }

  /** Do what a key asks for; return whether it asks for anything. */
  takeKey(key) {
    const actions = {
      ArrowLeft: () => this.pan(-0.1), ArrowRight: () => this.pan(0.1), "+": () => this.zoom(0.5), "-": () => this.zoom(2), Home: () => this.all(),
    };
    actions[key]?.();
    return key in actions;
  }
}
