/** The model of an axis as it is now, and what was learned since the page was opened. */

import { baseOptions } from "./charts.js";
import { button } from "./command_card.js";
import { el } from "./dom.js";
import { fixed } from "./format.js";
import { facts } from "./panels.js";
import { colour, onTheme } from "./theme.js";

/* global uPlot */
const ASK_EACH_MS = 2000;

/** Return the weights of a model in one row: first those of the right stops, then of the left ones. */
export function weightsOf(model) {
  if (model.surface_coefficients?.length) return model.surface_coefficients;
  return [...model.right_stop_weights, ...model.left_stop_weights];
}

/** Return the panel: `element`, `show` for each document of the stage, `close`. */
export function modelPanel(context, axis) {
  const plot = el("div", { class: "plot small", role: "img", "aria-label": "Weights of the model" });
  const note = el("p", { class: "note" });
  const { list, set } = facts({
    method: "identified by", drift: "drift of return point", gain: "change of gain", change: "weights changed by",
  });
  // Dialogs of their own, loaded when they are opened.
  const open = async (file) => (await import(file)).open(context);
  const buttons = el(
    "div", { class: "buttons" },
    button("Identify…", () => open("./identify.js")), button("Play and learn…", () => open("./learn.js")),
    button("Scan…", () => open("./scan.js")),
  );
  const element = el("section", { class: "panel" }, el("h2", {}, "Model"), buttons, plot, note, list);
  let [chart, first, shown, missed] = [null, null, null, false];

  const ask = async () => {
    const { up, status } = context.stage();
    const learning = status?.axes?.[axis.name()]?.mode !== "feedforward";
    if (document.hidden || !up || (shown && !learning && !missed && first?.axis === axis.name())) return;
    missed = learning; // once more after learning has ended
    const answer = await context.call("GET", "/v1/params").catch(() => null);
    const params = answer?.axes?.[axis.name()];
    if (params?.model) take(params);
  };
  const take = (params) => {
    const weights = weightsOf(params.model);
    if (first?.axis !== axis.name() || first.weights.length !== weights.length) {
      first = { axis: axis.name(), weights };
    }
    shown = params;
    draw(weights);
    const size = Math.hypot(...first.weights);
    const change = Math.hypot(...weights.map((each, index) => each - first.weights[index]));
    set("method", params.model.method);
    set("drift", `${fixed(100 * params.offset, 3)} % of range`);
    set("gain", `${fixed(100 * params.scale, 3)} %`);
    set("change", `${fixed(size ? (100 * change) / size : 0, 2)} %`);
    const surface = params.model.surface_coefficients?.length;
    note.textContent = surface ? "Coefficients of the surface. Dots: when this page was opened." : "Weights: right stops, then left. Dots: when this page was opened.";
  };
  const draw = (weights) => {
    const data = [weights.map((_, index) => index + 1), weights, first.weights];
    if (chart) chart.setData(data);
    else if (plot.clientWidth) chart = newChart(plot, data);
  };
  const sized = new ResizeObserver(() => chart?.setSize({ width: plot.clientWidth, height: plot.clientHeight }));
  sized.observe(plot);
  const forget = onTheme(() => chart?.redraw(false, true));
  const timer = setInterval(ask, ASK_EACH_MS);
  return {
    element,
    show: () => shown ?? ask(),
    close: () => {
      clearInterval(timer);
      forget();
      sized.disconnect();
      chart?.destroy();
    },
  };
}

function newChart(plot, data) {
  const base = baseOptions({ width: plot.clientWidth, height: plot.clientHeight });
  base.axes[0].values = (_, splits) => splits.map((each) => String(each));
  return new uPlot({
    ...base,
    scales: { x: { time: false, range: (u, low, high) => [low - 1, high + 1] }, y: {} },
    series: [
      {},
      {
        label: "now", stroke: () => colour("--learned"), fill: () => `${colour("--learned")}66`, width: 1,
        points: { show: false }, paths: uPlot.paths.bars({ size: [0.8, 30] }),
      },
      {
        label: "when this page was opened", stroke: () => colour("--muted"), paths: () => null,
        points: { show: true, size: 4, width: 1.5 },
      },
    ],
  }, data, plot);
}
