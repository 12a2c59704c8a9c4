/** The dialog that scans a raster: its outline before, the picture while it grows. */

import { el, field, svg } from "./dom.js";
import { fixed, UNKNOWN } from "./format.js";
import { axisSelect, JobDialog, numberInput, table } from "./job_dialog.js";

const SWEEPS = ["snake", "forward", "both"];
const BY = { "": "device, from a table", feedforward: "loop, feedforward", adaptive: "loop, adaptive", trimmed: "loop, trimmed" };
const SIZE = 200; // of the outline

class ScanDialog extends JobDialog {
  kind = "scan";
  title = "Scan";

  form() {
    this.spans = { fast: this.#span(0), slow: this.#span(1) };
    this.sweeps = el("select", {}, SWEEPS.map((kind) => el("option", { value: kind }, kind)));
    this.by = el("select", {}, Object.entries(BY).map(([mode, text]) => el("option", { value: mode }, text)));
    this.numbers = {
      lines_per_s: numberInput(5, { min: 0.001 }), interval_us: numberInput(50, { min: 0.1 }), passes: numberInput(3, { min: 0, max: 20, step: 1 }),
    };
    this.pulses = { pixel: pulseInput(), line: pulseInput(), frame: pulseInput() };
    const { lines_per_s, interval_us, passes } = this.numbers;
    this.outline = el("div");
    this.context.call("GET", "/v1/config").then((config) => this.#take(config), () => {});
    const form = el(
      "div", {},
      el("p", { class: "quiet" }, "The device plays a raster by its own clock, and whole frames are learned before the one that is stored; or the loop scans. The stage is disarmed at the end."),
      ...Object.entries(this.spans).map(([name, each]) => el(
        "div", { class: "fields" }, field(name === "fast" ? "Fast axis" : "Slow axis", each.axis), field("From", each.from_um, each.units[0]), field("To", each.to_um, each.units[1]), field("Pixels", each.pixels),
      )),
      el("div", { class: "fields" }, field("By", this.by), field("Sweeps", this.sweeps), field("Lines per second", lines_per_s), field("Corrections", passes)),
      el("details", {}, el("summary", {}, "Table and pulses"), el(
        "div", { class: "fields" }, field("Interval of the table", interval_us, "µs"),
        ...Object.entries(this.pulses).map(([name, input]) => field(`Line of pulses, ${name}`, input)),
      )),
      this.outline,
    );
    form.addEventListener("input", () => this.#draw());
    return [form];
  }

  #span(place) {
    const axis = axisSelect(this.context);
    axis.selectedIndex = Math.min(place, axis.options.length - 1);
    const units = [el("span", {}, "µm"), el("span", {}, "µm")];
    return { axis, units, from_um: numberInput(5), to_um: numberInput(15), pixels: numberInput(64, { min: 1, max: 10000, step: 1 }) };
  }

  #take(config) {
    this.axes = { ...config?.axes, ...config?.user_axes };
    this.#draw();
  }

  /** Draw what is swept over the range of the axes. */
  #draw() {
    const [x, y] = Object.values(this.spans).map((span) => {
      const { command_range_um: range, unit = "µm" } = this.axes?.[span.axis.value] ?? {};
      for (const each of span.units) each.textContent = unit;
      if (!range) return null;
      const at = (value) => (SIZE * (value - range[0])) / (range[1] - range[0]);
      const ends = [span.from_um.valueAsNumber, span.to_um.valueAsNumber].map(at);
      return { from: Math.min(...ends), width: Math.abs(ends[1] - ends[0]), range, unit };
    });
    if (!x || !y || ![x.from, x.width, y.from, y.width].every(Number.isFinite)) {
      this.outline.replaceChildren();
      return;
    }
    const text = `The scan within ${x.range.join(" to ")} ${x.unit} and ${y.range.join(" to ")} ${y.unit}`;
    this.outline.replaceChildren(svg(
      "svg", { viewBox: `-4 -4 ${SIZE + 8} ${SIZE + 24}`, class: "scan-outline", role: "img", "aria-label": text },
      svg("rect", { x: 0, y: 0, width: SIZE, height: SIZE, class: "range" }),
      svg("rect", { x: x.from, y: SIZE - y.from - y.width, width: x.width, height: y.width, class: "swept" }),
      svg("text", { x: 0, y: SIZE + 16 }, `${x.range[0]} to ${x.range[1]} ${x.unit}`),
    ));
  }

  wanted() {
    const spans = Object.fromEntries(Object.entries(this.spans).map(([name, { axis, units, ...numbers }]) => [name, { axis: axis.value, ...values(numbers) }]));
    const pulses = Object.fromEntries(Object.entries(values(this.pulses)).filter(([, line]) => Number.isFinite(line)));
    const by = this.by.value ? { mode: this.by.value } : { pulses };
    return { axis: spans.fast.axis, scan: { kind: "raster", ...spans, sweeps: this.sweeps.value, ...values(this.numbers), ...by } };
  }

  partsElement() {
    this.parts = el("div", { "aria-live": "polite" });
    return this.parts;
  }

  showParts({ parts }) {
    if (this.shown === parts.length && parts.length) return;
    this.shown = parts.length;
    const notes = parts.filter(({ note }) => note).map(({ note }) => el("p", { class: "quiet" }, note));
    this.parts.replaceChildren(...notes, ...pictures(parts), frameTable(parts.filter(({ frame }) => frame)));
  }

  result({ result, parts }) {
    return [
      el("p", {}, `Stored as ${result.file}.`), ...pictures(parts), frameTable(result.frames),
      el("div", { class: "buttons" }, el("button", { type: "button", class: "primary", onclick: () => this.dismiss() }, "Scan again")),
    ];
  }
}

function pulseInput() {
  return el("input", { type: "number", min: 1, max: 8, step: 1 });
}

function values(inputs) {
  return Object.fromEntries(Object.entries(inputs).map(([name, input]) => [name, input.valueAsNumber]));
}

/** Return the pictures so far, forward and backward side by side; rows that were not swept yet are empty. */
function pictures(parts) {
  const rows = parts.filter(({ row }) => row != null);
  const ways = [false, true].map((backward) => rows.filter((each) => each.backward === backward));
  // A snake has one picture: its backward rows are others.
  const apart = ways[0].some(({ row }) => ways[1].some((each) => each.row === row));
  return (apart ? ways : [rows]).filter((each) => each.length).map(picture);
}

function picture(rows) {
  const height = Math.max(...rows.map(({ place }) => place)) + 1;
  const width = rows[0].values.length;
  const canvas = el("canvas", { width, height, class: "scan-picture", role: "img", "aria-label": `Picture of ${rows.length} lines` });
  const all = rows.flatMap(({ values: each }) => each);
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const ink = canvas.getContext("2d");
  const image = ink.createImageData(width, height);
  for (const { place, values: each } of rows) {
    each.forEach((value, column) => {
      const grey = high > low ? (255 * (value - low)) / (high - low) : 128;
      image.data.set([grey, grey, grey, 255], 4 * ((height - 1 - place) * width + column));
    });
  }
  ink.putImageData(image, 0, 0);
  return canvas;
}

function frameTable(frames) {
  const number = (value) => (value == null ? UNKNOWN : fixed(value, 3));
  const row = ({ frame, measured_px: { fast_rms, slow_rms, apart_max } }) => [frame, number(fast_rms), number(slow_rms), number(apart_max)];
  return table("Measured errors in pixels, middle 80 %", [["", "along, rms", "across, rms", "forward to backward"], ...frames.map(row)]);
}

/** Open the dialog. */
export function open(context) {
  return new ScanDialog(context).open();
}
