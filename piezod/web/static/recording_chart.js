/** Two columns of a recording over time: a band from minimum to maximum, so that nothing is hidden. */

import { scaleText } from "./charts.js";
import { el, setText } from "./dom.js";
import { short, UNKNOWN } from "./format.js";
import { markInk } from "./recording_marks.js";
import { AXIS } from "./shown.js";
import { colour, onTheme } from "./theme.js";

/* global uPlot */
const HEIGHT = 340;
const INKS = ["command", "position"];
const GAP_PERIODS = 2.5;

/** Return the name of a column for people: "x: position, µm". */
export function columnLabel({ name, unit }) {
  const [group, column] = name.split("/");
  const words = AXIS[column]?.words ?? column.replace(/_(um|v|ns|s)$/, "").replaceAll("_", " ");
  const owner = group === "cycles" ? "loop" : group.replace(/^axis_/, "");
  return `${owner}: ${words}${unit ? `, ${unit.replace(/^u(?=m$|rad$)/, "µ")}` : ""}`;
}

/** The chart; it asks the span for zoom and pan, and shows what it is given. */
export class BandChart {
  #chart = null;
  #marks = [];
  #columns = [];
  #span;
  #rate_hz;

  constructor(span, rate_hz) {
    this.#span = span;
    this.#rate_hz = rate_hz;
    this.keys = INKS.map((ink) => ({ label: el("span"), value: el("output", { "aria-hidden": "true" }, UNKNOWN), ink }));
    this.at = el("output", { class: "quiet", "aria-hidden": "true" });
    this.plot = el("div", {
      class: "plot recording-plot", tabindex: "0", role: "img",
      "aria-label": "Recording over time. Arrow keys pan, plus and minus zoom, Home shows all.",
    });
    this.figure = el(
      "figure", { class: "chart" },
      el(
        "figcaption", {},
        el("span", { class: "legend" }, this.keys.map(({ ink, label, value }) => el("span", { class: "key" }, el("i", { class: `swatch ${ink}` }), label, value))),
        this.at, el("span", { class: "note" }, "Drag to zoom, double-click for all, wheel to zoom, Shift and wheel to pan."),
      ),
      this.plot,
    );
    this.plot.addEventListener("keydown", (event) => !event.ctrlKey && span.takeKey(event.key) && event.preventDefault());
    this.plot.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    this.forget = onTheme(() => this.#chart?.redraw(false, true));
    this.sized = new ResizeObserver(() => this.#chart?.setSize({ width: this.plot.clientWidth, height: HEIGHT }));
    this.sized.observe(this.plot);
  }

  /** Show the extremes of both columns in a span. */
  show(views, columns, { begin_s, end_s }) {
    const same = this.#chart && columns.every((column, index) => column.name === this.#columns[index].name);
    this.#columns = columns;
    columns.forEach((column, index) => setText(this.keys[index].label, columnLabel(column)));
    const data = joined(views.map((view) => withGaps(view, GAP_PERIODS / this.#rate_hz)));
    if (!same) {
      this.#chart?.destroy();
      this.#chart = this.#create(data);
    }
    this.#chart.batch(() => {
      this.#chart.setData(data, false);
      this.#chart.setScale("x", { min: begin_s, max: end_s });
    });
  }

  /** Show the span at once, with the data of before; those of the span follow. */
  setSpan() {
    this.#chart?.setScale("x", { min: this.#span.begin_s, max: this.#span.end_s });
  }

  showMarks(marks) {
    this.#marks = marks;
    this.#chart?.redraw(false);
  }

  close() {
    this.forget();
    this.sized.disconnect();
    this.#chart?.destroy();
  }

  #wheel(event) {
    if (!this.#chart) return;
    event.preventDefault();
    if (event.shiftKey || event.deltaX) this.#span.pan(0.001 * (event.deltaX || event.deltaY));
    else this.#span.zoom(2 ** (0.002 * event.deltaY), this.#chart.posToVal(event.clientX - this.#chart.over.getBoundingClientRect().left, "x"));
  }

  #create(data) {
    const [left, right] = this.#columns;
    const scales = [left, right].map(({ unit, names }, index) => (names.length || !unit ? `y${index}` : unit));
    const shared = scales[0] === scales[1];
    const axis = { grid: { stroke: () => colour("--grid"), width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif", gap: 6 };
    const valueAxis = (index) => ({
      ...axis, scale: scales[index], side: index ? 1 : 3, size: 60, space: 28, grid: index ? { show: false } : axis.grid,
      stroke: () => colour(shared ? "--muted" : `--${INKS[index]}`),
      values: (_, splits) => splits.map((value) => this.#columns[index].names[value] ?? (this.#columns[index].names.length ? "" : scaleText(value, splits))),
      ...(this.#columns[index].names.length ? { incrs: [1, 2, 5, 10] } : {}),
    });
    const line = (index) => ({ scale: scales[index], stroke: () => colour(`--${INKS[index]}`), width: 1.2, points: { show: false }, spanGaps: false });
    return new uPlot({
      width: Math.max(this.plot.clientWidth, 60), height: HEIGHT,
      legend: { show: false },
      cursor: { y: false, drag: { x: true, y: false, setScale: false }, points: { show: false } },
      scales: { x: { time: false, auto: false } },
      axes: [
        { ...axis, stroke: () => colour("--muted"), size: 30, space: 80, values: (_, splits) => splits.map((value) => `${scaleText(value, splits)} s`) },
        valueAxis(0), ...(shared ? [] : [valueAxis(1)]),
      ],
      series: [{}, line(0), line(0), line(1), line(1)],
      bands: [0, 1].map((index) => ({ series: [2 * index + 2, 2 * index + 1], fill: () => `${colour(`--${INKS[index]}`)}55` })),
      hooks: {
        draw: [(chart) => this.#drawMarks(chart)],
        setCursor: [(chart) => this.#read(chart)],
        setSelect: [(chart) => this.#select(chart)],
        ready: [(chart) => chart.over.addEventListener("dblclick", () => this.#span.all())],
      },
    }, data, this.plot);
  }

  #select(chart) {
    const { left, width } = chart.select;
    if (width < 4) return;
    const [begin_s, end_s] = [left, left + width].map((pixel) => chart.posToVal(pixel, "x"));
    chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.#span.set(begin_s, end_s);
  }

  #read(chart) {
    const { idx, left } = chart.cursor;
    const inside = idx != null && left >= 0;
    setText(this.at, inside ? `at ${short(chart.data[0][idx])} s` : "");
    this.keys.forEach(({ value }, index) => setText(value, inside ? this.#extremes(chart, index, idx) : ""));
  }

  #extremes(chart, index, idx) {
    const [low, high] = [chart.data[2 * index + 1][idx], chart.data[2 * index + 2][idx]];
    const text = (value) => this.#columns[index].names[value] ?? short(value);
    return low === high ? text(low) : `${text(low)} … ${text(high)}`;
  }

  #drawMarks(chart) {
    const { ctx, bbox } = chart;
    ctx.save();
    for (const { begin_s, end_s, kind } of this.#marks) {
      const [begin, end] = [begin_s, end_s].map((t_s) => chart.valToPos(t_s, "x", true));
      if (end < bbox.left || begin > bbox.left + bbox.width) continue;
      ctx.fillStyle = colour(markInk(kind));
      ctx.globalAlpha = 0.85;
      const left = Math.max(begin, bbox.left);
      ctx.fillRect(left - 1, bbox.top, Math.max(2, Math.min(end, bbox.left + bbox.width) - left), 7);
      ctx.globalAlpha = 0.28;
      ctx.fillRect(left - 1, bbox.top, 2, bbox.height);
    }
    ctx.restore();
  }
}

/** Return the columns of a view for uPlot; where the recording has a gap, the line has one too. */
function withGaps(view, longest_s) {
  const columns = [[], [], []];
  view.begin_s.forEach((begin_s, index) => {
    const before_s = view.end_s[index - 1];
    if (index && begin_s - before_s > longest_s) push((before_s + begin_s) / 2, null, null);
    push((begin_s + view.end_s[index]) / 2, view.minimum[index], view.maximum[index]);
  });
  function push(...values) {
    values.forEach((value, index) => columns[index].push(value));
  }
  return columns;
}

/** Return the data of two columns: both have the same buckets, unless the recording grew meanwhile. */
function joined([left, right]) {
  if (left[0].length === right[0].length) return [...left, right[1], right[2]];
  return uPlot.join([left, right]);
}
