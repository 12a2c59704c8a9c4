/** The dialog that identifies an axis: drive it, fit a model, look at it, and use it or not. */

import { el, field } from "./dom.js";
import { fixed, short } from "./format.js";
import { axisSelect, JobDialog, numberInput, table } from "./job_dialog.js";

const METHODS = {
  auto: "chosen by cross-validation", surface: "surface of loops", "least-squares": "stop operators", lms: "stop operators, the paper's method",
};
const ERRORS = ["position_error_max_pct", "position_error_rms_pct", "voltage_error_max_pct", "voltage_error_rms_pct"];

class IdentifyDialog extends JobDialog {
  kind = "identify";
  title = "Identify an axis";

  form() {
    this.axis = axisSelect(this.context);
    this.axis.addEventListener("change", () => this.#fill());
    this.method = el("select", {}, Object.entries(METHODS).map(([name, text]) => el("option", { value: name }, text)));
    this.drive = el("select", {}, el("option", { value: "full" }, "complete, 80 s"), el("option", { value: "chosen" }, "decaying swings"));
    this.numbers = { low_v: numberInput(0), high_v: numberInput(100), duration_s: numberInput(30, { min: 5, max: 600 }) };
    this.chosen = el(
      "fieldset", { class: "fields", disabled: true }, el("legend", {}, "Decaying swings"),
      field("From", this.numbers.low_v, "V"), field("To", this.numbers.high_v, "V"), field("Duration", this.numbers.duration_s, "s"),
    );
    this.drive.addEventListener("change", () => (this.chosen.disabled = this.drive.value === "full"));
    this.#fill();
    return [
      el("p", { class: "quiet" }, "The stage is stopped, rests, is zeroed, driven over the voltages, and disarmed at the end. Other axes rest."),
      el("div", { class: "fields" }, field("Axis", this.axis), field("Model", this.method), field("Drive", this.drive)),
      this.chosen,
      el("p", { class: "quiet" }, "The complete drive goes over all voltages and has everything that a fit needs. Decaying swings are shorter, and tell less about creep and small loops."),
    ];
  }

  /** Fill in the voltages that the axis allows. */
  async #fill() {
    const { axes } = await this.context.call("GET", "/v1/config").catch(() => ({ axes: {} }));
    const limits = axes[this.axis.value]?.limits;
    if (!limits) return;
    for (const [name, value] of [["low_v", limits.drive_min_v], ["high_v", limits.drive_max_v]]) {
      Object.assign(this.numbers[name], { value, min: limits.drive_min_v, max: limits.drive_max_v });
    }
  }

  wanted() {
    const drive = Object.fromEntries(Object.entries(this.numbers).map(([name, input]) => [name, input.valueAsNumber]));
    return { axis: this.axis.value, method: this.method.value, ...(this.drive.value === "full" ? {} : { drive }) };
  }

  result(job) {
    const { result, axis } = job;
    const accept = el("button", { type: "button", class: "primary", onclick: () => this.#accept(axis, result.model) }, "Use this model");
    return [
      el("ul", { class: "notes" }, result.verdict.lines.map((line) => el("li", {}, line))),
      el("p", {}, `Axis ${axis}: ${METHODS[result.method] ?? result.method}${result.order ? `, ${result.order} on each side` : ""}, delay ${fixed(1000 * result.delay_s, 2)} ms, ${result.creep ? `creep ${short(100 * result.creep_per_decade)} % a decade` : "no creep"}.`),
      table("Errors in % of the range", [
        ["", "position, worst", "rms", "voltage, worst", "rms"],
        ["fitted record", ...ERRORS.map((name) => fixed(result.train[name], 3))],
        ["held-out blocks", ...ERRORS.map((name) => fixed(result.cross_validation[name], 3))],
      ]),
      ...notes(result),
      job.figure ? figure(`jobs/${encodeURIComponent(this.stage)}.png?${Date.now()}`) : null,
      el("div", { class: "buttons" }, accept, el("button", { type: "button", onclick: () => this.dismiss() }, "Reject it")),
    ].filter(Boolean);
  }

  async #accept(axis, model) {
    await this.try_(async () => {
      await this.context.call("POST", "/v1/model", { axis, model });
      const save = el("button", { type: "button", class: "primary", onclick: () => this.#save() }, "Save the parameters");
      this.done.replaceChildren(
        el("p", { role: "status" }, `Axis ${axis} uses this model from now on. Its hysteresis memory is unknown: arm and condition the stage before a mode that adapts.`),
        el("p", { class: "quiet" }, "Saved parameters are used at the next start, too."),
        el("div", { class: "buttons" }, save, el("button", { type: "button", onclick: () => this.close() }, "Close")),
      );
    });
  }

  async #save() {
    await this.try_(async () => {
      await this.context.call("POST", "/v1/params/save", {});
      this.context.notify("The parameters are saved.", "good");
      this.close();
    });
  }
}

/** Return the figure of the command, which opens in its full size. */
function figure(href) {
  return el(
    "a", { href, target: "_blank" },
    el("img", { class: "figure", src: href, alt: "Measured and model over time and as a loop, and the residuals; opens in full size" }),
  );
}

/** Return what is doubtful; the verdict says what the record lacks. */
function notes({ misfits, questions, warnings }) {
  const texts = [...misfits, ...questions, ...warnings];
  if (!texts.length) return [];
  return [el("details", { open: true }, el("summary", {}, `Notes (${texts.length})`), el("ul", { class: "notes" }, texts.map((text) => el("li", {}, text))))];
}

/** Open the dialog. */
export function open(context) {
  return new IdentifyDialog(context).open();
}
