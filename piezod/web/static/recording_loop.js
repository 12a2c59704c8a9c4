/** Displacement against drive of the part of a recording that is shown. */

import { scaleText } from "./charts.js";
import { el } from "./dom.js";
import { colour, onTheme } from "./theme.js";

/* global uPlot */
const HEIGHT = 320;

/** The chart. */
export class LoopChart {
  #chart = null;

  constructor() {
    this.plot = el("div", { class: "plot loop-plot", role: "img", "aria-label": "Displacement in µm against drive voltage in V, of the part that is shown" });
    this.figure = el("figure", { class: "chart" }, el("figcaption", {}, el("strong", {}, "Displacement against drive"), el("span", { class: "unit" }, "µm, V")), this.plot);
    this.forget = onTheme(() => this.#chart?.redraw(false, true));
    this.sized = new ResizeObserver(() => this.#chart?.setSize({ width: this.plot.clientWidth, height: HEIGHT }));
    this.sized.observe(this.plot);
  }

  show({ drive_v, position_um }) {
    const data = [null, [drive_v, position_um]];
    if (this.#chart) this.#chart.setData(data);
    else this.#chart = this.#create(data);
  }

  close() {
    this.forget();
    this.sized.disconnect();
    this.#chart?.destroy();
  }

  #create(data) {
    const axis = {
      stroke: () => colour("--muted"), grid: { stroke: () => colour("--grid"), width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif", gap: 6,
    };
    return new uPlot({
      mode: 2,
      width: Math.max(this.plot.clientWidth, 60), height: HEIGHT,
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: false, range: padded(0) }, y: { range: padded(1) } },
      axes: [
        { ...axis, size: 30, space: 70, values: (_, splits) => splits.map((value) => `${scaleText(value, splits)} V`) },
        { ...axis, size: 60, space: 28, values: (_, splits) => splits.map((value) => scaleText(value, splits)) },
      ],
      series: [{}, { facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }], paths: drawLine, stroke: () => colour("--drive") }],
    }, data, this.plot);
  }
}

/** Return a range of a scale with a margin. */
function padded(facet) {
  return (chart) => {
    let [low, high] = [Infinity, -Infinity];
    for (const value of chart.data[1][facet]) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    if (low > high) return [0, 1];
    const margin = 0.05 * (high - low || 1);
    return [low - margin, high + margin];
  };
}

/** Draw the rows in the order of time, as a line; uPlot's own paths need growing values. */
function drawLine(chart) {
  const { ctx, bbox } = chart;
  const [drive_v, position_um] = chart.data[1];
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.beginPath();
  drive_v.forEach((value, index) => ctx.lineTo(chart.valToPos(value, "x", true), chart.valToPos(position_um[index], "y", true)));
  ctx.strokeStyle = colour("--drive");
  ctx.lineWidth = 1.2 * devicePixelRatio;
  ctx.lineJoin = "round";
  ctx.stroke();
  ctx.restore();
  return null;
}
