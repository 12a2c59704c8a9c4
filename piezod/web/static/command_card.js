/** A group of controls, with the answer of the stage beside them: what was refused, and what helps. */

import { el, newId, setText, withCode } from "./dom.js";

/** A card of controls. `run` sends a request and shows its refusal in the card. */
export class CommandCard {
  /**
   * @param {string} title Heading.
   * @param {...Node} children Controls.
   */
  constructor(title, ...children) {
    const id = newId("card");
    this.said = "";
    this.barred = "";
    this.why = el("span", { class: "why", id: newId("why") });
    this.refusal = el("p", { class: "refusal", role: "status" });
    this.element = el(
      "section", { class: "control-card", "aria-labelledby": id },
      el("div", { class: "card-head" }, el("h2", { id }, title), this.why), ...children, this.refusal,
    );
    this.element.addEventListener("click", (event) => this.#stopAtBar(event), { capture: true });
  }

  /**
   * Bar controls for which there is a reason, and free the others.
   *
   * @param {Array<[HTMLElement, string]>} reasons Controls and reasons; "" is none.
   * @param {string} shown The reason that stands beside the heading.
   */
  bar(reasons, shown) {
    for (const [control, reason] of reasons) bar(control, reason, reason === shown ? this.why.id : null);
    setText(this.why, shown && `Not now: ${shown}`);
    const barred = reasons.map(([, reason]) => reason).join();
    if (barred !== this.barred) this.say("");
    this.barred = barred;
  }

  /** Say why a barred control does nothing; fields send their form by a click on its button. */
  #stopAtBar(event) {
    const control = event.target.closest("[aria-disabled]");
    if (!control) return;
    event.preventDefault();
    event.stopPropagation();
    this.say(control.title);
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

/**
 * Bar a control while there is a reason, which its title tells; "" frees it.
 *
 * A barred button keeps the focus, so that the keyboard stays where it is and the reason is read.
 *
 * @param {string|null} describedBy Id of the element that shows the reason.
 */
export function bar(control, reason, describedBy = null) {
  control.dataset.title ??= control.title;
  control.title = reason ? `Not now: ${reason}` : control.dataset.title;
  if (control.tagName !== "BUTTON") control.disabled = Boolean(reason);
  else if (reason) control.setAttribute("aria-disabled", "true");
  else control.removeAttribute("aria-disabled");
  if (reason && describedBy) control.setAttribute("aria-describedby", describedBy);
  else control.removeAttribute("aria-describedby");
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
