/** Start a waveform. Its curve is drawn before it starts, with the range that the stage allows. */

import { objection } from "./availability.js";
import { CommandCard } from "./command_card.js";
import { el, field, svg } from "./dom.js";
import { fixed, short } from "./format.js";

const KINDS = { sine: "sine", triangle: "triangle" };
const [WIDTH, HEIGHT, POINTS] = [300, 84, 120];

/** Return the value of a waveform after a number of periods: it starts at its lowest value. */
export function valueAt({ kind, low, high }, periods) {
  const phase = periods - Math.floor(periods);
  const part = kind === "sine" ? (1 - Math.cos(2 * Math.PI * phase)) / 2 : 1 - Math.abs(1 - 2 * phase);
  return low + (high - low) * part;
}

/** Return the largest speed of a waveform, in µm/s. */
export function speed_um_per_s({ kind, low, high, frequency_hz }) {
  return (high - low) * frequency_hz * (kind === "sine" ? Math.PI : 2);
}

/** Return why a waveform cannot be started; "" if the page sees no reason. */
export function mistake({ low, high, frequency_hz, duration_s }, range) {
  if (![low, high, frequency_hz, duration_s].every(Number.isFinite)) return "Fill in all fields.";
  if (low >= high) return `Low must be below high: ${short(low)} µm and ${short(high)} µm.`;
  if (range && (low < range[0] || high > range[1])) {
    return `Outside the range of commands: ${short(low)} to ${short(high)} µm, allowed ${short(range[0])} to ${short(range[1])} µm.`;
  }
  if (frequency_hz <= 0) return "The frequency must be above 0 Hz.";
  if (duration_s <= 0) return "The duration must be above 0 s.";
  return "";
}

/** Return the card, and the function that shows each document of the stage. */
export function waveCard(context, axis) {
  const input = (value) => el("input", { type: "number", step: "any", required: true, value });
  const kind = el("select", {}, Object.keys(KINDS).map((each) => el("option", { value: each }, KINDS[each])));
  const fields = { low: input("2"), high: input("20"), frequency_hz: input("1"), duration_s: input("60") };
  const preview = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "preview", role: "img" });
  const facts = el("p", { class: "facts" });
  const start = el("button", { type: "submit", class: "primary", "aria-label": "Start the wave" }, "Start");
  const form = el(
    "form", { class: "fields" },
    field("Kind", kind), field("Low", fields.low, "µm"), field("High", fields.high, "µm"),
    field("Frequency", fields.frequency_hz, "Hz"), field("Duration", fields.duration_s, "s"), start,
    el("div", { class: "preview-box" }, preview, facts),
  );
  const card = new CommandCard("Waveform", form);
  const values = () => ({
    kind: kind.value, ...Object.fromEntries(Object.entries(fields).map(([name, each]) => [name, each.valueAsNumber])),
  });
  let drawn = "";
  const show = () => {
    const wave = values();
    const range = axis.range_um();
    const why = objection("wave", context);
    card.bar([[start, why || mistake(wave, range)]], why);
    const key = JSON.stringify([wave, range]);
    if (key === drawn) return;
    drawn = key;
    const problem = mistake(wave, range);
    facts.classList.toggle("problem", Boolean(problem));
    facts.textContent = problem || `largest speed ${short(speed_um_per_s(wave))} µm/s · ${short(wave.frequency_hz * wave.duration_s)} periods`;
    draw(preview, wave, range, problem);
  };
  form.addEventListener("input", show);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const { duration_s, ...wave } = values();
    card.run(context.call("POST", "/v1/wave", { command_um: { [axis.name()]: wave }, duration_s }));
  });
  return { card, show };
}

/** Draw two periods, or fewer if the wave is shorter, over the range of commands. */
function draw(preview, wave, range, problem) {
  const known = [wave.low, wave.high].every(Number.isFinite) && wave.low < wave.high;
  const bounds = [...(range ?? []), ...(known ? [wave.low, wave.high] : [])];
  preview.replaceChildren();
  if (!bounds.length) return;
  const [bottom, top] = [Math.min(...bounds), Math.max(...bounds)];
  const y = (value) => HEIGHT - 12 - ((value - bottom) / (top - bottom || 1)) * (HEIGHT - 24);
  if (range) preview.append(svg("rect", { class: "range", x: 0, width: WIDTH, y: y(range[1]), height: y(range[0]) - y(range[1]) }));
  if (!known) return;
  const periods = Math.min(2, wave.frequency_hz * wave.duration_s || 2);
  const points = Array.from({ length: POINTS + 1 }, (_, index) => {
    const part = index / POINTS;
    return `${(part * WIDTH).toFixed(1)},${y(valueAt(wave, part * periods)).toFixed(1)}`;
  });
  preview.append(svg("polyline", { class: problem ? "curve bad" : "curve", points: points.join(" ") }));
  const seconds = periods / wave.frequency_hz;
  preview.setAttribute("aria-label", `${wave.kind} from ${short(wave.low)} to ${short(wave.high)} µm, ${short(seconds)} s shown`);
  const text = (x, at, anchor, value) => svg("text", { x, y: at, "text-anchor": anchor }, value);
  preview.append(
    text(3, y(top) - 3, "start", `${fixed(top, 1)} µm`), text(3, HEIGHT - 2, "start", `${fixed(bottom, 1)} µm`),
    text(WIDTH - 3, HEIGHT - 2, "end", `${short(seconds)} s`),
  );
}
