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
    this.source = el("select", {}, el("option", { value: "stage" }, "made on this stage"), el("option", { value: "file" }, "a file"));
    this.source.addEventListener("change", () => this.#choose());
    this.fromStage = el("div", {}, this.#stageFields());
    this.fromFile = el("div", { hidden: true }, this.#fileFields());
    return [
      el("div", { class: "fields" }, field("Record", this.source), field("Axis", this.axis), field("Model", this.method)),
      this.fromStage, this.fromFile,
    ];
  }

  #stageFields() {
    return [
      el("p", { class: "quiet" }, "The stage is stopped, rests, is zeroed, driven over the voltages, and disarmed at the end. Other axes rest."),
      el("div", { class: "fields" }, field("Drive", this.drive)),
      this.chosen,
      el("p", { class: "quiet" }, "The complete drive goes over all voltages and has everything that a fit needs. Decaying swings are shorter, and tell less about creep and small loops."),
    ];
  }

  /** Return the fields for a file: what of it is which column. */
  #fileFields() {
    const text = (placeholder) => el("input", { type: "text", placeholder, maxlength: 500, spellcheck: "false" });
    this.file = el("input", { type: "file" });
    this.file.addEventListener("change", () => (this.sent = null));
    this.choices = {
      columns: text("t=TIME,drive=CH1,position=CH2"), scale: text("drive=20,position=2"), offset: text("position=-10"),
      invert: el("select", {}, el("option", { value: "" }, "nothing"), el("option", { value: "position" }, "position")),
      rate_hz: numberInput("", { required: false, min: 0 }),
    };
    this.preview = el("section", { "aria-label": "How the file is read" });
    const { columns, scale, offset, invert, rate_hz } = this.choices;
    return [
      el("p", { class: "quiet" }, "CSV, .xlsx, .mat, .tdms, .lvm, .npz, .parquet or HDF5 with time, voltage and position. Columns are told by names and units; say what cannot be told."),
      el("div", { class: "fields" }, field("File", this.file), field("Columns", columns), field("Scale", scale), field("Offset", offset), field("Invert", invert), field("Without time", rate_hz, "Hz")),
      el("div", { class: "buttons" }, el("button", { type: "button", onclick: () => this.#look() }, "Preview")),
      this.preview,
    ];
  }

  #choose() {
    this.fromStage.hidden = this.source.value === "file";
    this.fromFile.hidden = !this.fromStage.hidden;
  }

  /** Send the chosen file, unless the server has it. */
  async #send() {
    const file = this.file.files[0];
    if (!file) throw refusal("no file is chosen");
    if (this.sent === file) return;
    const headers = { "x-file-name": encodeURIComponent(file.name) };
    const answer = await fetch(`uploads/${encodeURIComponent(this.stage)}`, { method: "POST", body: file, headers }).catch(() => null);
    if (!answer?.ok) {
      const { error } = (await answer?.json().catch(() => null)) ?? {};
      throw refusal(error ? `${error.what}; ${error.remedy}` : "the file could not be sent: it is too large, or the server has ended");
    }
    this.sent = file;
  }

  async #look() {
    await this.try_(async () => {
      await this.#send();
      this.show(await this.request({ do: "import", axis: this.axis.value, file: this.#said() }));
    });
  }

  /** Return what is said about the columns. */
  #said() {
    const { rate_hz, ...texts } = this.choices;
    const said = Object.fromEntries(Object.entries(texts).map(([name, input]) => [name, input.value.trim()]));
    return rate_hz.value === "" ? said : { ...said, rate_hz: rate_hz.valueAsNumber };
  }

  async start() {
    if (this.source.value !== "file") return super.start();
    let sent = false;
    await this.try_(async () => {
      await this.#send();
      sent = true;
    });
    return sent ? super.start() : undefined;
  }

  show(job) {
    if (job?.kind !== "import" || job.running) return super.show(job);
    super.show(null);
    this.source.value = "file";
    this.#choose();
    this.preview.replaceChildren(...(job.result ? preview(job.result, job.figure && this.#figure()) : []));
    if (!job.error) return undefined;
    const columns = job.error.match(/--columns (?:'([^']*)'|(\S+))/);
    if (columns && !this.choices.columns.value) this.choices.columns.value = columns[1] ?? columns[2];
    return this.say(job.error);
  }

  #figure() {
    return `jobs/${encodeURIComponent(this.stage)}.png?${Date.now()}`;
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
    const wanted = { axis: this.axis.value, method: this.method.value };
    if (this.source.value === "file") return { ...wanted, file: this.#said() };
    const drive = Object.fromEntries(Object.entries(this.numbers).map(([name, input]) => [name, input.valueAsNumber]));
    return this.drive.value === "full" ? wanted : { ...wanted, drive };
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
      job.figure ? figure(this.#figure()) : null,
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

/** Return an error that the dialog shows. */
function refusal(what) {
  return Object.assign(new Error(what), { what });
}

/** Return what was understood of a file: its columns, rate, ranges and picture. */
function preview({ read_as, samples, rate_hz, drive_v, position_um, warnings }, href) {
  const range = ([low, high], unit) => `${short(low)} to ${short(high)} ${unit}`;
  return [
    el("p", { role: "status" }, `${samples} samples at ${short(rate_hz)} Hz; drive ${range(drive_v, "V")}; position ${range(position_um, "µm")}.`),
    el("ul", { class: "notes" }, [...read_as, ...warnings].map((text) => el("li", {}, text))),
    href ? figure(href) : null,
  ].filter(Boolean);
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
