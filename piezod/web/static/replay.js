/** The dialog that replays a recording: would the present model of the stage have done better? */

import { el, field } from "./dom.js";
import { fixed } from "./format.js";
import { JobDialog, table } from "./job_dialog.js";

const HEADS = ["mode", "time, s", "recorded error, rms µm", "worst", "replayed error, rms µm", "worst", "drive differs, rms V"];

class ReplayDialog extends JobDialog {
  kind = "replay";
  title = "Replay the recording";

  constructor(context, recording, axes) {
    super(context);
    Object.assign(this, { recording, axes });
  }

  form() {
    this.axis = el("select", {}, this.axes.map((name) => el("option", { value: name }, name)));
    return [
      el("p", { class: "quiet" }, "The control law runs again on the recorded commands and samples, with the model that the axis has now. The stage does not move."),
      el("div", { class: "fields" }, field("Axis", this.axis)),
    ];
  }

  wanted() {
    return { axis: this.axis.value, recording: this.recording };
  }

  result(job) {
    const { recording, axis, model, modes, verdict, warnings } = job.result;
    return [
      el("p", {}, `${recording}, axis ${axis}, with ${model ? "the present model of the stage" : "the model of the recording: the axis has none now"}.`),
      table("Errors in each recorded mode", [HEADS, ...modes.map(rowOf)]),
      el("p", {}, verdict),
      warnings.length ? el("ul", { class: "notes" }, warnings.map((text) => el("li", {}, text))) : null,
      job.figure ? this.#figure() : null,
      el("div", { class: "buttons" }, el("button", { type: "button", onclick: () => this.dismiss() }, "Replay again")),
    ].filter(Boolean);
  }

  /** Return the figure of the command, which opens in its full size. */
  #figure() {
    const href = `jobs/${encodeURIComponent(this.stage)}.png?${Date.now()}`;
    const alt = "Recorded and replayed error, and the difference of the drives, over time; opens in full size";
    return el("a", { href, target: "_blank" }, el("img", { class: "figure", src: href, alt }));
  }
}

function rowOf(row) {
  const errors = [row.recorded_rms_um, row.recorded_worst_um, row.rms_um, row.worst_um];
  return [row.recorded, fixed(row.duration_s, 1), ...errors.map((each) => fixed(each, 3)), fixed(row.drive_rms_v, 3)];
}

/** Open the dialog. */
export function open(context, recording, axes) {
  return new ReplayDialog(context, recording, axes).open();
}
