/** Start a waveform. Its curve is drawn before it starts, with the range that the stage allows. */

import { objection } from "./availability.js";
import { CommandCard } from "./command_card.js";
import { el, field, svg } from "./dom.js";
import { fixed, short } from "./format.js";

/** All numbers of waveforms: caption, first value and unit. */
const NUMBERS = {
  low: ["Low", "2", "µm"], high: ["High", "20", "µm"], frequency_hz: ["Frequency", "1", "Hz"],
  from_hz: ["From", "1", "Hz"], to_hz: ["To", "10", "Hz"], sweep_s: ["Sweep", "60", "s"], duration_s: ["Duration", "60", "s"],
};
const cosine = (turns) => (1 - Math.cos(2 * Math.PI * turns)) / 2;
const triangle = (turns) => 1 - Math.abs(1 - 2 * (turns - Math.floor(turns)));
const periodic = {
  numbers: ["frequency_hz"], turns: ({ frequency_hz }, t_s) => frequency_hz * t_s,
  fastest_hz: ({ frequency_hz }) => frequency_hz, shown_s: ({ frequency_hz }) => 2 / frequency_hz,
};

/**
 * The kinds: their numbers besides low, high and duration, the part of the swing after so many turns, its steepest
 * slope per turn, the turns after a time, the highest frequency, and the time that is drawn.
 */
const KINDS = {
  sine: { ...periodic, part: cosine, steepest: Math.PI },
  triangle: { ...periodic, part: triangle, steepest: 2 },
  chirp: {
    numbers: ["from_hz", "to_hz", "sweep_s"], part: cosine, steepest: Math.PI,
    turns: ({ from_hz, to_hz, sweep_s }, t_s) => {
      const swept_s = Math.min(t_s, sweep_s);
      return (from_hz + ((to_hz - from_hz) / sweep_s / 2) * swept_s) * swept_s + to_hz * (t_s - swept_s);
    },
    fastest_hz: ({ from_hz, to_hz }) => Math.max(from_hz, to_hz),
    shown_s: ({ from_hz, to_hz, sweep_s }) => Math.min(sweep_s, 40 / (from_hz + to_hz)),
  },
};
/** The kinds that a table can repeat: those with a frequency. */
export const PERIODIC = Object.keys(KINDS).filter((kind) => KINDS[kind].numbers.includes("frequency_hz"));
const [WIDTH, HEIGHT, POINTS] = [300, 84, 240];

/** Return the value of a waveform at a time: it starts at its lowest value. */
export function valueAt(wave, t_s) {
  const { part, turns } = KINDS[wave.kind];
  return wave.low + (wave.high - wave.low) * part(turns(wave, t_s));
}

/** Return the largest speed of a waveform, in µm/s. */
export function speed_um_per_s(wave) {
  const { fastest_hz, steepest } = KINDS[wave.kind];
  return (wave.high - wave.low) * steepest * fastest_hz(wave);
}

/** Return why a waveform cannot be started; "" if the page sees no reason. */
export function mistake({ kind, low, high, ...times }, range) {
  if (![low, high, ...Object.values(times)].every(Number.isFinite)) return "Fill in all fields.";
  if (low >= high) return `Low must be below high: ${short(low)} µm and ${short(high)} µm.`;
  if (range && (low < range[0] || high > range[1])) {
    return `Outside the range of commands: ${short(low)} to ${short(high)} µm, allowed ${short(range[0])} to ${short(range[1])} µm.`;
  }
  const [name] = Object.keys(times).filter((each) => times[each] <= 0);
  return name ? `${NUMBERS[name][0]} must be above 0 ${NUMBERS[name][2]}.` : "";
}

/** Return the card, and the function that shows each document of the stage. */
export function waveCard(context, axis) {
  const kind = el("select", {}, Object.keys(KINDS).map((each) => el("option", { value: each }, each)));
  const inputs = {}, fields = {};
  for (const [name, [caption, value, unit]] of Object.entries(NUMBERS)) {
    inputs[name] = el("input", { type: "number", step: "any", required: true, value });
    fields[name] = field(caption, inputs[name], unit);
  }
  const preview = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "preview", role: "img" });
  const facts = el("p", { class: "facts" });
  const start = el("button", { type: "submit", class: "primary", "aria-label": "Start the wave" }, "Start");
  const form = el(
    "form", { class: "fields" },
    field("Kind", kind), ...Object.values(fields), start,
    el("div", { class: "preview-box" }, preview, facts),
  );
  const card = new CommandCard("Waveform", form);
  const used = () => ["low", "high", ...KINDS[kind.value].numbers, "duration_s"];
  const values = () => ({ kind: kind.value, ...Object.fromEntries(used().map((name) => [name, inputs[name].valueAsNumber])) });
  let drawn = "";
  const show = () => {
    const wave = values();
    for (const name in fields) fields[name].hidden = inputs[name].disabled = !(name in wave);
    const range = axis.range_um();
    const why = axis.moved() || objection("wave", context);
    card.bar([[start, why || mistake(wave, range)]], why);
    const key = JSON.stringify([wave, range, axis.unit()]);
    if (key === drawn) return;
    drawn = key;
    const problem = mistake(wave, range);
    facts.classList.toggle("problem", Boolean(problem));
    const about = problem || `largest speed ${short(speed_um_per_s(wave))} µm/s · ${short(KINDS[wave.kind].turns(wave, wave.duration_s))} periods`;
    facts.textContent = about.replaceAll("µm", axis.unit());
    draw(preview, wave, range, problem, axis.unit());
  };
  form.addEventListener("input", show);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const { duration_s, ...wave } = values();
    card.run(context.call("POST", "/v1/wave", { command_um: { [axis.name()]: wave }, duration_s }));
  });
  return { card, show };
}

/** Draw a wave, or its beginning, over the range of commands. */
function draw(preview, wave, range, problem, unit) {
  const known = [wave.low, wave.high].every(Number.isFinite) && wave.low < wave.high;
  const bounds = [...(range ?? []), ...(known ? [wave.low, wave.high] : [])];
  preview.replaceChildren();
  if (!bounds.length) return;
  const [bottom, top] = [Math.min(...bounds), Math.max(...bounds)];
  const y = (value) => HEIGHT - 12 - ((value - bottom) / (top - bottom || 1)) * (HEIGHT - 24);
  if (range) preview.append(svg("rect", { class: "range", x: 0, width: WIDTH, y: y(range[1]), height: y(range[0]) - y(range[1]) }));
  const shown_s = KINDS[wave.kind].shown_s(wave);
  const seconds = Math.min(shown_s, wave.duration_s || shown_s);
  if (!known || !(seconds > 0)) return;
  const points = Array.from({ length: POINTS + 1 }, (_, index) => {
    const part = index / POINTS;
    return `${(part * WIDTH).toFixed(1)},${y(valueAt(wave, part * seconds)).toFixed(1)}`;
  });
  preview.append(svg("polyline", { class: problem ? "curve bad" : "curve", points: points.join(" ") }));
  preview.setAttribute("aria-label", `${wave.kind} from ${short(wave.low)} to ${short(wave.high)} ${unit}, ${short(seconds)} s shown`);
  const text = (x, at, anchor, value) => svg("text", { x, y: at, "text-anchor": anchor }, value);
  preview.append(
    text(3, y(top) - 3, "start", `${fixed(top, 1)} ${unit}`), text(3, HEIGHT - 2, "start", `${fixed(bottom, 1)} ${unit}`),
    text(WIDTH - 3, HEIGHT - 2, "end", `${short(seconds)} s`),
  );
}
