/** The charts over time, on uPlot: at most two series each, in the colours of the theme. */

import { el, setText } from "./dom.js";
import { capital, clockTime, fixed } from "./format.js";
import { AXIS, STAGE } from "./shown.js";
import { colour, onTheme } from "./theme.js";

/* global uPlot */
const SCALE_PX = 54; // of the left scale: numbers of any length fit, so that nothing moves
const SHOWN = { ...STAGE, ...AXIS };
/** In place of an error. */
export const NO_ERROR = "nothing is commanded";
const FONT = "11px system-ui, sans-serif";

/** Return the options that all charts share: scales in quiet colours, and no legend by uPlot. */
export function baseOptions({ width, height }) {
  const axis = {
    stroke: () => colour("--muted"),
    grid: { stroke: () => colour("--grid"), width: 1 },
    ticks: { show: false },
    font: FONT,
    gap: 6,
  };
  return {
    width: Math.max(width, 60),
    height: Math.max(height, 60),
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 16, 0, 0],
    axes: [
      { ...axis, size: 26, space: 80 },
      { ...axis, size: SCALE_PX, space: 28, values: (_, splits) => splits.map((each) => scaleText(each, splits)) },
    ],
  };
}

/** Return a number of a scale with the decimals that its steps need. */
export function scaleText(value, splits) {
  const step = splits.length > 1 ? Math.abs(splits[1] - splits[0]) : 1;
  const decimals = [0, 1, 2, 3, 4, 5].find((each) => Math.abs(step * 10 ** each - Math.round(step * 10 ** each)) < 1e-3);
  return fixed(value, decimals ?? 6); // steps such as 2.5 need a digit more than their size tells
}

/**
 * Return a range for values that stays as it is while it fits them well.
 *
 * @param {number} least Smallest height of the range: noise does not fill a chart.
 */
export function steadyRange(least, fromZero = false) {
  let range = [0, least];
  return (low, high) => {
    if (low == null || high == null) return range;
    if (fromZero) low = 0;
    const height = Math.max(high - low, least);
    const fits = low >= range[0] && high <= range[1] && height > 0.55 * (range[1] - range[0]);
    if (!fits) {
      const middle = (low + high) / 2;
      const margin = 0.08 * height;
      range = fromZero ? [0, height + margin] : [middle - height / 2 - margin, middle + height / 2 + margin];
    }
    return range;
  };
}

/** Return the frame of a chart: a figure with a heading, a legend, and a place to draw. */
export function frame(title, unit, series, note = "") {
  const legend = series.map(({ label, ink }) => el("span", { class: "key" }, el("i", { class: `swatch ${ink}` }), label));
  const plot = el("div", { class: "plot", role: "img", "aria-label": `${title}, in ${unit}` });
  const noteLine = el("span", { class: "note" }, note);
  const figure = el(
    "figure", { class: "chart" },
    el("figcaption", {}, el("strong", {}, title), el("span", { class: "unit" }, unit), el("span", { class: "legend" }, legend), noteLine),
    plot,
  );
  return { figure, plot, noteLine };
}

/** A chart of one or two quantities over time. */
export class TimeChart {
  /**
   * @param {object} options `columns` (one or two fields of telemetry of the same unit), `inks`, `least`
   *   (smallest height of the scale, in the unit), `fromZero`, `wide`, `empty` (what no known value means).
   * @param {() => object} view Returns `ring`, `span_s` and `now_s`.
   */
  constructor(options, view) {
    const fields = options.columns.map((name) => SHOWN[name]);
    this.series = fields.map(({ words }, index) => ({ label: words, ink: options.inks[index], wide: options.wide && !index }));
    const title = fields.length > 1 ? capital(fields.map(({ words }) => words).join(" and ")) : fields[0].what;
    const { figure, plot, noteLine } = frame(title, fields[0].unit, this.series);
    figure.classList.toggle("wide", Boolean(options.wide));
    Object.assign(this, { options, view, figure, element: plot, noteLine, width: 0, chart: null });
    this.range = steadyRange(options.least, options.fromZero);
    this.forget = onTheme(() => this.chart?.redraw(false, true));
  }

  /** Time between two drawings, in ms: of an interval, or the time in which the picture moves by half a pixel. */
  get each_ms() {
    const least_ms = this.options.wide ? 33 : 66; // half the pictures for the small charts: they cost the most
    return Math.max(least_ms, (500 * this.view().span_s) / Math.max(this.width, 100));
  }

  resize(width, height) {
    this.width = width; // reading it from the element would cost a layout for each frame
    if (this.chart) this.chart.setSize({ width, height });
    else if (width > 0) this.#create(width, height);
  }

  draw() {
    if (!this.chart) return;
    const { ring, span_s, now_s } = this.view();
    const data = ring.lines.since(now_s - span_s - 1, ["time_s", ...this.options.columns]);
    this.chart.setData(data);
    if (!this.options.empty) return;
    const known = data[1].some((each) => each != null);
    this.figure.classList.toggle("unknown", !known);
    setText(this.noteLine, known ? "" : this.options.empty);
  }

  close() {
    this.forget();
    this.chart?.destroy();
  }

  #create(width, height) {
    const { series } = this;
    const base = baseOptions({ width, height });
    // A time at the very end would be cut off.
    base.axes[0].values = (u, splits) => splits.map((each) => (u.valToPos(each, "x") > u.width - SCALE_PX - 36 ? "" : clockTime(each)));
    this.chart = new uPlot({
      ...base,
      scales: {
        x: { time: true, range: () => [this.view().now_s - this.view().span_s, this.view().now_s] },
        y: { range: (_, low, high) => this.range(low, high) },
      },
      series: [{}, ...series.map(({ label, ink, wide }) => ({
        label, stroke: () => colour(`--${ink}`), width: wide ? 4 : 1.5, alpha: wide ? 0.55 : 1, points: { show: false },
      }))],
    }, [[], ...series.map(() => [])], this.element);
  }
}
