/** Charts of what the error is made of: its distribution and its spectrum. */

import { NO_ERROR, baseOptions, frame, scaleText } from "./charts.js";
import { setText } from "./dom.js";
import { fixed, short } from "./format.js";
import { SEGMENT, histogram, rms, spectrum } from "./signals.js";
import { colour, onTheme } from "./theme.js";

/* global uPlot */
const NM = 1000; // per µm
const LEAST_NM = 2;
const RATE_HZ = 30; // of telemetry, until it is known
const GAP_S = 0.5;

/** Common part: a chart of one series that is not over time. */
class StatisticsChart {
  each_ms = 500; // the eye cannot follow more, and these cost more than lines

  constructor(title, unit, view) {
    const { figure, plot, noteLine } = frame(title, unit, []);
    Object.assign(this, { view, figure, element: plot, noteLine, chart: null });
    this.forget = onTheme(() => this.chart?.redraw(false, true));
  }

  resize(width, height) {
    if (this.chart) this.chart.setSize({ width, height });
    else if (width > 0) this.chart = new uPlot(this.options(baseOptions({ width, height })), [[], []], this.element);
  }

  close() {
    this.forget();
    this.chart?.destroy();
  }

  /** Return the errors of the shown time in nm, one for each interval. */
  errors_nm() {
    const { ring, span_s, now_s } = this.view();
    const [times_s, errors_um] = ring.samples.since(now_s - span_s, ["time_s", "error_um"]);
    return { times_s, errors_nm: errors_um.map((each) => (each == null ? null : NM * each)) };
  }
}

/** How often which error occurs. */
export class HistogramChart extends StatisticsChart {
  constructor(view) {
    super("Errors", "% over nm", view);
  }

  options(base) {
    base.axes[0].values = (_, splits) => splits.map((each) => `${scaleText(each, splits)} nm`);
    base.axes[1].values = (_, splits) => splits.map((each) => `${scaleText(each, splits)} %`);
    return {
      ...base,
      scales: {
        x: { time: false, range: (u, low, high) => [low - this.width, high + this.width] },
        y: { range: (u, low, high) => [0, Math.max(5, 1.08 * (high ?? 0))] },
      },
      series: [{}, {
        stroke: () => colour("--error"), fill: () => `${colour("--error")}55`, width: 1,
        points: { show: false }, paths: uPlot.paths.bars({ size: [0.9, 60] }),
      }],
    };
  }

  width = LEAST_NM;

  draw() {
    const { errors_nm } = this.errors_nm();
    const { centres, width, shares } = histogram(errors_nm, LEAST_NM);
    this.width = width;
    this.chart?.setData([centres, shares]);
    const known = errors_nm.filter((each) => each != null);
    const text = known.length ? `rms ${fixed(rms(errors_nm), 1)} nm · ${known.length} samples` : NO_ERROR;
    setText(this.noteLine, text);
  }
}

/** At which frequencies the error is. Only slow ones: telemetry has 30 samples per s. */
export class SpectrumChart extends StatisticsChart {
  constructor(view) {
    super("Spectrum", "nm/√Hz", view);
  }

  options(base) {
    base.axes[0].values = (_, splits) => splits.map((each) => `${scaleText(each, splits)} Hz`);
    base.axes[1].values = (_, splits) => splits.map((each) => (each == null ? "" : short(each)));
    return {
      ...base,
      scales: {
        x: { time: false, range: (u, low, high) => [0, high ?? 15] },
        y: { distr: 3, range: (u, low, high) => [10 ** Math.floor(Math.log10(low || 0.1)), 10 ** Math.ceil(Math.log10(high || 100))] },
      },
      series: [{}, { stroke: () => colour("--error"), width: 1.6, points: { show: false } }],
    };
  }

  draw() {
    const { times_s, errors_nm } = this.errors_nm();
    const rate_hz = rateOf(times_s);
    const { frequencies_hz, density, segments } = spectrum(errors_nm, rate_hz);
    this.chart?.setData([frequencies_hz, density]);
    const known = errors_nm.some((each) => each != null);
    const without = known ? `needs ${Math.ceil(SEGMENT / RATE_HZ)} s without a gap` : NO_ERROR;
    setText(this.noteLine, segments ? `up to ${fixed(rate_hz / 2, 0)} Hz; faster errors folded in` : without);
  }
}

/** Return the mean rate of samples from their times, without the time of gaps. */
function rateOf(times_s) {
  const steps = times_s.slice(1).map((each, index) => each - times_s[index]).filter((each) => each < GAP_S);
  return steps.length ? steps.length / steps.reduce((sum, each) => sum + each, 0) : RATE_HZ;
}
