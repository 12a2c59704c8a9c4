/** A dialog for something that runs for minutes: its form, its progress, and its result. */

import { objection } from "./availability.js";
import { bar } from "./command_card.js";
import { el, newId, setText, withCode } from "./dom.js";

const KINDS = { identify: "identification", import: "reading a file", learn: "learning", scan: "scan", replay: "replay" };
let opened = null; // one dialog at a time

/**
 * A dialog beside the page. It does not cover the emergency stop, and the page can be used meanwhile.
 *
 * A subclass has `kind`, `title`, and `form()` (elements), `wanted()` (the message that starts it),
 * `showParts(job)` and `result(job)` (elements).
 */
export class JobDialog {
  constructor(context) {
    opened?.close();
    opened = this;
    this.context = context;
    this.stage = context.stage().stage;
    this.back = document.activeElement;
    this.dismissed = false;
  }

  /** Build the dialog and show it, with the job of the stage if there is one. */
  async open() {
    const id = newId("dialog");
    this.problem = el("p", { class: "refusal", role: "alert" });
    this.startButton = el("button", { type: "submit", class: "primary" }, "Start");
    this.why = el("span", { class: "why", id: newId("why") });
    this.form_ = el("form", {}, this.form(), el("div", { class: "buttons" }, this.startButton, this.why));
    this.activity = el("p", { role: "status" });
    this.bar = el("progress", { max: 1, value: 0, "aria-label": "Progress" });
    this.running = el(
      "section", { hidden: true, "aria-label": "Progress" }, this.activity, this.bar, this.partsElement?.() ?? null,
      el("div", { class: "buttons" }, el("button", { type: "button", onclick: () => this.end() }, "Stop it")),
    );
    this.done = el("section", { hidden: true, "aria-label": "Result" });
    this.element = el(
      "dialog", { class: "job-dialog", "aria-labelledby": id },
      el("div", { class: "dialog-head" }, el("h2", { id, tabindex: "-1" }, this.title), el("button", { type: "button", class: "plain", "aria-label": `Close ${this.title}`, onclick: () => this.close() }, "×")),
      this.problem, this.form_, this.running, this.done,
    );
    this.form_.addEventListener("submit", (event) => {
      event.preventDefault();
      if (!this.#allow()) this.start();
    });
    this.element.addEventListener("keydown", (event) => event.key === "Escape" && this.close());
    document.body.append(this.element);
    this.element.show(); // not modal: the emergency stop stays in reach
    this.element.querySelector("h2").focus();
    const ours = ({ stage, job }) => stage === this.stage && this.show(job);
    const leave = () => this.close();
    const forget = [
      this.context.socket.on("job", ours), this.context.socket.on("open", () => this.look()), this.context.onStage(() => this.#allow()),
    ];
    this.#allow();
    window.addEventListener("hashchange", leave);
    this.forget = () => {
      for (const each of forget) each();
      window.removeEventListener("hashchange", leave);
    };
    await this.look();
  }

  close() {
    this.forget?.();
    this.element?.remove();
    if (opened === this) opened = null;
    if (this.back?.isConnected) this.back.focus();
  }

  async look() {
    await this.try_(async () => this.show((await this.request({ do: "job" })).job));
  }

  async start() {
    await this.try_(async () => {
      this.dismissed = false;
      this.show(await this.request({ do: this.kind, ...this.wanted() }));
    });
  }

  async end() {
    await this.try_(() => this.request({ do: "end_job" }));
  }

  /** Show the form again; the result stays with the server until the next one. */
  dismiss() {
    this.dismissed = true;
    this.#sections(this.form_);
  }

  request(message) {
    return this.context.socket.request({ stage: this.stage, ...message });
  }

  /** Do something; show its refusal in the dialog. */
  async try_(action) {
    try {
      await action();
      this.say("");
    } catch (error) {
      if (!error.what) throw error;
      this.say(error.message);
    }
  }

  say(text) {
    this.problem.replaceChildren(...withCode(text));
  }

  show(job) {
    if (!job || (job.kind !== this.kind && !job.running)) {
      this.#sections(this.form_);
      return;
    }
    if (job.running) {
      const other = job.kind !== this.kind;
      setText(this.activity, other ? `The stage is busy: ${KINDS[job.kind]}.` : `${upper(job.activity)} …`);
      if (job.share > 0) this.bar.value = job.share;
      else this.bar.removeAttribute("value"); // it is not known: the bar moves
      if (!other) this.showParts?.(job);
      this.#sections(this.running);
    } else if (job.error) {
      this.#sections(this.form_);
      this.say(upper(job.error));
    } else if (!this.dismissed) {
      this.done.replaceChildren(...this.result(job));
      this.#sections(this.done);
    }
  }

  /** Bar the start while there is a reason, which stands beside it; return the reason. */
  #allow() {
    const reason = objection(this.kind, this.context);
    bar(this.startButton, reason, this.why.id);
    setText(this.why, reason && `Not now: ${reason}`);
    return reason;
  }

  #sections(shown) {
    for (const each of [this.form_, this.running, this.done]) each.hidden = each !== shown;
  }
}

/** Return a select with the axes of a stage. */
export function axisSelect(context) {
  const names = Object.keys(context.stage().status?.axes ?? {});
  return el("select", {}, names.map((name) => el("option", { value: name }, name)));
}

/** Return a field for a number. */
export function numberInput(value, attributes = {}) {
  return el("input", { type: "number", step: "any", required: true, value, ...attributes });
}

/** Return a table of rows of texts; the first row is the head. */
export function table(caption, [head, ...rows]) {
  return el(
    "table", { class: "numbers-table" }, el("caption", {}, caption),
    el("thead", {}, el("tr", {}, head.map((text) => el("th", { scope: "col" }, text)))),
    el("tbody", {}, rows.map(([name, ...cells]) => el("tr", {}, el("th", { scope: "row" }, name), cells.map((text) => el("td", {}, text))))),
  );
}

function upper(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
