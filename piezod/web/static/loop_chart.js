/** Position against another quantity: the loop of the hysteresis, older parts fainter. */

import { baseOptions, frame, scaleText, steadyRange } from "./charts.js";
import { setText } from "./dom.js";
import { capital } from "./format.js";
import { AXIS } from "./shown.js";
import { colour, onTheme } from "./theme.js";

/* global uPlot */
const PARTS = 4; // of the shown time; each is drawn fainter than the next one
const JOINED_PART = 0.12; // neighbours closer than this part of the picture are joined by a line

/** The loop of the last seconds: samples of the same cycle, hence no line where they are far apart. */
export class LoopChart {
  each_ms = 66;

  /**
   * @param {object} options `column` (against which the position is drawn), `least` (smallest width of
   *   its scale, in its unit), `empty` (what no known value means).
   * @param {() => object} view Returns `ring`, `span_s` and `now_s`.
   */
  constructor(options, view) {
    const [up, across] = [AXIS.position_um, AXIS[options.column]];
    this.units = [across.unit, up.unit];
    const title = `${capital(up.words)} against ${across.words}`;
    const { figure, plot, noteLine } = frame(title, `${up.unit} over ${across.unit}`, []);
    figure.classList.add("loop");
    Object.assign(this, { options, view, figure, element: plot, noteLine, chart: null });
    this.ranges = [steadyRange(options.least), steadyRange(0.5)];
    this.forget = onTheme(() => this.chart?.redraw(false, true));
  }

  resize(width, height) {
    if (this.chart) this.chart.setSize({ width, height });
    else if (width > 0) this.#create(width, height);
  }

  draw() {
    const { ring, span_s, now_s } = this.view();
    const columns = ring.samples.since(now_s - span_s, [this.options.column, "position_um"]);
    this.chart?.setData([null, columns]);
    const unknown = this.options.empty && !columns[0].some((each) => each != null);
    this.figure.classList.toggle("unknown", Boolean(unknown));
    setText(this.noteLine, unknown ? this.options.empty : "");
  }

  close() {
    this.forget();
    this.chart?.destroy();
  }

  #create(width, height) {
    const base = baseOptions({ width, height });
    base.axes[0].values = (_, splits) => splits.map((each) => `${scaleText(each, splits)} ${this.units[0]}`);
    base.axes[1].values = (_, splits) => splits.map((each) => `${scaleText(each, splits)} ${this.units[1]}`);
    base.axes[1].size = 64;
    base.padding[1] = 28; // half a label of the last value
    this.chart = new uPlot({
      ...base,
      mode: 2,
      scales: {
        x: { time: false, auto: true, range: (u) => this.#range(u, 0) },
        y: { auto: true, range: (u) => this.#range(u, 1) },
      },
      series: [null, { facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }], paths: (u) => this.#paint(u) }],
    }, [null, [[], []]], this.element);
  }

  #range(u, facet) {
    let [low, high] = [Infinity, -Infinity];
    for (const each of u.data?.[1]?.[facet] ?? []) {
      if (each == null) continue;
      if (each < low) low = each;
      if (each > high) high = each;
    }
    return this.ranges[facet](low === Infinity ? null : low, low === Infinity ? null : high);
  }

  #paint(u) {
    const { ctx, bbox, data: [, [across, position]] } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.strokeStyle = ctx.fillStyle = colour("--position");
    ctx.lineWidth = 1.5 * devicePixelRatio;
    const x = across.map((each) => each == null ? null : u.valToPos(each, "x", true));
    const y = position.map((each) => each == null ? null : u.valToPos(each, "y", true));
    for (let part = 0; part < PARTS; part += 1) {
      ctx.globalAlpha = (part + 1) / PARTS;
      this.#paintPart(ctx, x, y, Math.floor((part * x.length) / PARTS), Math.floor(((part + 1) * x.length) / PARTS), bbox);
    }
    this.#paintNewest(ctx, x.at(-1), y.at(-1));
    ctx.restore();
    return null;
  }

  #paintPart(ctx, x, y, begin, end, bbox) {
    const size = 1.4 * devicePixelRatio;
    ctx.beginPath();
    for (let i = begin; i < end; i += 1) {
      if (x[i] == null || y[i] == null) continue;
      const known = i > 0 && x[i - 1] != null && y[i - 1] != null;
      const joined = known && Math.abs(x[i] - x[i - 1]) < JOINED_PART * bbox.width && Math.abs(y[i] - y[i - 1]) < JOINED_PART * bbox.height;
      if (joined) {
        ctx.moveTo(x[i - 1], y[i - 1]);
        ctx.lineTo(x[i], y[i]);
      } else {
        ctx.fillRect(x[i] - size, y[i] - size, 2 * size, 2 * size);
      }
    }
    ctx.stroke();
  }

  #paintNewest(ctx, x, y) {
    if (x == null || y == null) return;
    ctx.globalAlpha = 1;
    ctx.beginPath();
    ctx.arc(x, y, 4 * devicePixelRatio, 0, 2 * Math.PI);
    ctx.fill();
  }
}
