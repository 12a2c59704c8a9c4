/** A group of controls, with the answer of the stage beside them: what was refused, and what helps. */

import { el, newId, withCode } from "./dom.js";

/** A card of controls. `run` sends a request and shows its refusal in the card. */
export class CommandCard {
  /**
   * @param {string} title Heading.
   * @param {...Node} children Controls.
   */
  constructor(title, ...children) {
    const id = newId("card");
    this.said = "";
    this.refusal = el("p", { class: "refusal", role: "status" });
    this.element = el(
      "section", { class: "control-card", "aria-labelledby": id }, el("h2", { id }, title), ...children, this.refusal,
    );
  }

  /** Show a text that says why something is not possible; "" removes it. */
  say(text) {
    if (this.said === text) return;
    this.said = text;
    this.refusal.replaceChildren(...withCode(text));
  }

  /** Wait for a request; return its result, or null after its refusal was shown. */
  async run(request) {
    try {
      const result = await request;
      this.say("");
      return result;
    } catch (error) {
      this.say(error.message);
      return null;
    }
  }
}

/** Return a button that calls a function. */
export function button(text, onclick, attributes = {}) {
  return el("button", { type: "button", onclick, ...attributes }, text);
}

/**
 * Sends the newest value of many, one at a time: for a slider that moves faster than answers come.
 *
 * A value that is replaced before it was sent is never sent; the last one always is.
 */
export class NewestOnly {
  #waiting = null;
  #busy = false;

  /** @param {(value: number) => Promise} send @param {number} each_ms Least time between two. */
  constructor(send, each_ms) {
    Object.assign(this, { send, each_ms });
  }

  async put(value) {
    this.#waiting = { value };
    if (this.#busy) return;
    this.#busy = true;
    while (this.#waiting) {
      const { value: newest } = this.#waiting;
      this.#waiting = null;
      await Promise.all([this.send(newest), new Promise((done) => setTimeout(done, this.each_ms))]);
    }
    this.#busy = false;
  }
}
