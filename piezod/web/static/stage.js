/** The page of one stage: charts, controls, and what the stage reports. */

import { NO_ERROR, TimeChart } from "./charts.js";
import { controls } from "./controls.js";
import { el } from "./dom.js";
import { eventsPanel } from "./events_panel.js";
import { bannerPanel, faultsPanel } from "./faults_panel.js";
import { LoopChart } from "./loop_chart.js";
import { modelPanel } from "./model_panel.js";
import { Painter } from "./painter.js";
import { detailsPanel, headPanel, readoutsPanel } from "./panels.js";
import { Ring } from "./ring.js";
import { HistogramChart, SpectrumChart } from "./statistics_charts.js";

const SPANS_S = { 5: "5 s", 10: "10 s", 30: "30 s", 120: "2 min" };
const AWAY_EACH_MS = 500; // the charts go on while nothing arrives, so that the gap is seen
const CHARTS = [
  { columns: ["command_um", "position_um"], inks: ["command", "position"], least: 0.5, wide: true },
  { columns: ["error_um"], inks: ["error"], least: 0.02, empty: NO_ERROR },
  { columns: ["drive_v"], inks: ["drive"], least: 2 },
  { columns: ["late_max_us"], inks: ["timing"], least: 20, fromZero: true },
];
/** Side by side: the loop that the compensation follows, and the line that it makes of it. */
const LOOPS = [
  { column: "drive_v", least: 4 },
  { column: "command_um", least: 0.5, empty: NO_ERROR },
];

/** The axis that is shown, with its part of the configuration. */
class ShownAxis {
  #name = "";
  #config = null;

  constructor(context, rings) {
    Object.assign(this, { context, rings });
  }

  name = () => this.#name || Object.keys(this.context.stage().status?.axes ?? {})[0] || "";
  choose = (name) => (this.#name = name);
  config = () => this.#config;
  newest = () => this.ring().newest;
  /** Its part of the configuration; that of a user axis has the same keys. */
  part = () => this.#config?.axes?.[this.name()] ?? this.#config?.user_axes?.[this.name()] ?? null;
  range_um = () => this.part()?.command_range_um ?? null;
  #status = () => this.context.stage().status?.axes?.[this.name()];
  unit = () => this.#status()?.unit ?? "µm";
  /** Why it takes no commands: user axes move it; empty if it does. */
  moved = () => (this.#status()?.moved_by ? `${this.name()} is moved by ${this.#status().moved_by}: choose one of those` : "");

  ring = () => {
    const name = this.name();
    if (!this.rings.has(name)) this.rings.set(name, new Ring());
    return this.rings.get(name);
  };

  async ask() {
    this.#config = await this.context.call("GET", "/v1/config").catch(() => this.#config);
  }
}

/** Show a stage in an element; return a function that ends it. */
export function mount(element, context) {
  const rings = new Map();
  const axis = new ShownAxis(context, rings);
  const painter = new Painter();
  const clock = { arrived_ms: 0, span_s: 10 };
  const view = () => {
    const ring = axis.ring();
    // Between two rows, and while none arrives, the time goes on at the speed of this machine.
    const waited_s = ring.lastTime_s ? Math.max(0, performance.now() - clock.arrived_ms - 100) / 1000 : 0;
    return { ring, span_s: clock.span_s, now_s: (ring.lastTime_s || Date.now() / 1000) + waited_s };
  };

  const head = headPanel(context);
  const faults = faultsPanel();
  const banner = bannerPanel();
  const readouts = readoutsPanel(view);
  const commands = controls(context, axis);
  const details = detailsPanel(context, axis);
  const model = modelPanel(context, axis);
  const events = eventsPanel(context);
  const time = (options) => new TimeChart(options, view);
  const loops = LOOPS.map((options) => new LoopChart(options, view));
  const charts = [...CHARTS.map(time), ...loops, new HistogramChart(view), new SpectrumChart(view)];
  charts.forEach((chart) => painter.add(chart));
  const axes = el("div", { class: "choices", role: "radiogroup", "aria-label": "Axis", hidden: true });
  element.append(
    head.element, banner.element,
    el(
      "div", { class: "columns" },
      el("section", { class: "controls", "aria-label": "Controls" }, axes, commands.elements),
      el(
        "section", { class: "middle", "aria-label": "Measured values" },
        readouts.element, spanChoice(clock, painter), charts[0].figure, el("div", { class: "charts" }, charts.slice(1).map(({ figure }) => figure)),
      ),
      el("section", { class: "side", "aria-label": "Details" }, details.element, model.element, faults.element, events.element),
    ),
  );

  const show = (stage, change) => {
    element.classList.toggle("stale", !stage.up || !context.socket.connected);
    showAxes(axes, stage, axis, () => show(context.stage()));
    showUnit(element, axis.unit());
    for (const panel of [head, banner, faults, commands, details, model, events]) panel.show(stage, change);
    if (change?.up) axis.ask().then(() => {
      for (const panel of [commands, details]) panel.show(context.stage());
    });
  };
  const forgets = [
    context.onStage(show),
    context.socket.on("telemetry", (event) => {
      if (event.stage !== context.stage().stage) return;
      for (const name of Object.keys(event.axes)) ringOf(rings, name).take(event, name);
      clock.arrived_ms = performance.now();
      readouts.draw();
      painter.touch();
    }),
  ];
  const timer = setInterval(() => {
    if (performance.now() - clock.arrived_ms > AWAY_EACH_MS) painter.touch();
    commands.show(context.stage());
    faults.show(context.stage());
    if (!context.stage().up) head.show(context.stage());
  }, AWAY_EACH_MS);
  show(context.stage(), { up: context.stage().up });
  return () => {
    clearInterval(timer);
    forgets.forEach((forget) => forget());
    for (const part of [commands, model, events, painter]) part.close();
  };
}

/** Write the unit of the shown axis wherever the page has the unit of a position. */
function showUnit(element, unit) {
  const base = unit.slice(1); // m or rad, after µ or n
  for (const each of element.querySelectorAll(".unit")) {
    const text = each.textContent.replace(/^([µn])(?:m|rad)(?=\/|$)/, `$1${base}`);
    if (text !== each.textContent) each.textContent = text;
  }
}

function ringOf(rings, name) {
  if (!rings.has(name)) rings.set(name, new Ring());
  return rings.get(name);
}

function spanChoice(clock, painter) {
  const radios = Object.entries(SPANS_S).map(([value, text]) => {
    const choose = () => {
      clock.span_s = Number(value);
      painter.touch();
    };
    const input = el("input", { type: "radio", name: "span", value, checked: Number(value) === clock.span_s, onchange: choose });
    return el("label", { class: "choice" }, input, el("span", {}, text));
  });
  return el("div", { class: "choices spans", role: "radiogroup", "aria-label": "Time shown" }, radios);
}

/** Let a person choose the axis, if there is more than one. */
function showAxes(group, { status }, axis, chosen) {
  const names = Object.keys(status?.axes ?? {});
  group.hidden = names.length < 2;
  if (group.hidden || group.children.length === names.length) return;
  group.replaceChildren(...names.map((name) => {
    const choose = () => {
      axis.choose(name);
      chosen();
    };
    const input = el("input", { type: "radio", name: "axis", value: name, checked: name === axis.name(), onchange: choose });
    return el("label", { class: "choice" }, input, el("span", {}, `axis ${name}`));
  }));
}
