/** The dialog that lets a device play a waveform, and learns it from pass to pass. */

import { el, field } from "./dom.js";
import { fixed, UNKNOWN } from "./format.js";
import { axisSelect, JobDialog, numberInput, table } from "./job_dialog.js";
import { PassChart } from "./pass_chart.js";
import { PERIODIC } from "./wave_card.js";

class LearnDialog extends JobDialog {
  kind = "learn";
  title = "Play and learn a waveform";

  form() {
    this.axis = axisSelect(this.context);
    this.wave = el("select", {}, PERIODIC.map((kind) => el("option", { value: kind }, kind)));
    this.numbers = { low: numberInput(8), high: numberInput(16), frequency_hz: numberInput(50, { min: 0.1 }) };
    this.options = {
      passes: numberInput(6, { min: 0, max: 50, step: 1 }), interval_us: numberInput(50, { min: 0.1 }),
      settle_s: numberInput(1, { min: 0, max: 60 }), record_s: numberInput(1, { min: 0, max: 60 }),
    };
    const { passes, interval_us, settle_s, record_s } = this.options;
    return [
      el("p", { class: "quiet" }, "The device plays a table of voltages by its own clock and records the sensor. Each pass corrects the table by the error. Setpoints are refused meanwhile; the stage is disarmed at the end."),
      el(
        "div", { class: "fields" }, field("Axis", this.axis), field("Waveform", this.wave),
        field("Low", this.numbers.low, "µm"), field("High", this.numbers.high, "µm"), field("Frequency", this.numbers.frequency_hz, "Hz"), field("Passes", passes),
      ),
      el("details", {}, el("summary", {}, "Table and times"), el(
        "div", { class: "fields" }, field("Interval of the table", interval_us, "µs"), field("Settle", settle_s, "s"), field("Record", record_s, "s"),
      )),
    ];
  }

  wanted() {
    const values = (inputs) => Object.fromEntries(Object.entries(inputs).map(([name, input]) => [name, input.valueAsNumber]));
    return { axis: this.axis.value, command_um: { kind: this.wave.value, ...values(this.numbers) }, ...values(this.options) };
  }

  partsElement() {
    this.parts = el("div", { "aria-live": "polite" });
    return this.parts;
  }

  showParts({ parts }) {
    if (this.shown === parts.length && parts.length) return;
    this.shown = parts.length;
    const passes = parts.filter(({ label }) => label);
    const notes = parts.filter(({ note }) => note).map(({ note }) => el("p", { class: "quiet" }, note));
    this.parts.replaceChildren(...notes, ...(passes.length ? [passChart(passes), passTable(passes, null)] : []));
  }

  result({ result, axis }) {
    return [
      el("p", {}, `Axis ${axis}: ${result.stopped}. Best: ${result.best}. Its table is kept: the next play of this waveform begins with it.`),
      passChart(result.passes), passTable(result.passes, result.best),
      el("div", { class: "buttons" }, el("button", { type: "button", class: "primary", onclick: () => this.dismiss() }, "Play another")),
    ];
  }
}

function passChart(passes) {
  return new PassChart(passes).element;
}

function passTable(passes, best) {
  const row = (each) => [each.label === best ? `${each.label} (best)` : each.label, ...["max_pct", "rms_pct", "mean_pct", "noise_pct"].map((name) => (each[name] == null ? UNKNOWN : fixed(each[name], 3)))];
  return table("Errors in % of the swing", [["", "worst", "rms", "mean", "noise"], ...passes.map(row)]);
}

/** Open the dialog. */
export function open(context) {
  return new LearnDialog(context).open();
}
