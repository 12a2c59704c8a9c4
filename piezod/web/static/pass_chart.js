/** The error of each pass, as it falls: worst and rms, in % of the swing, on a logarithmic scale. */

import { svg } from "./dom.js";
import { short } from "./format.js";

const [WIDTH, HEIGHT, LEFT, BOTTOM] = [460, 170, 58, 24];
const SERIES = [["max_pct", "error", "worst"], ["rms_pct", "position", "rms"]];

/** The chart as SVG, drawn once. */
export class PassChart {
  constructor(passes) {
    const values = passes.flatMap((each) => SERIES.map(([name]) => each[name])).filter((value) => value > 0);
    const low = Math.floor(Math.log10(Math.min(...values, 1)));
    const high = Math.max(Math.ceil(Math.log10(Math.max(...values, 0))), low + 1);
    const x = (index) => LEFT + 12 + ((WIDTH - LEFT - 90) * index) / Math.max(passes.length - 1, 1);
    const y = (value) => 10 + ((HEIGHT - BOTTOM - 10) * (high - Math.log10(value))) / (high - low);
    const text = `Error of each pass: worst ${passes.map((each) => short(each.max_pct)).join(", ")} % of the swing`;
    this.element = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "pass-chart", role: "img", "aria-label": text });
    for (let power = low; power <= high; power += 1) {
      const at = y(10 ** power);
      this.element.append(
        svg("line", { x1: LEFT, x2: WIDTH - 70, y1: at, y2: at, class: "grid-line" }),
        svg("text", { x: LEFT - 6, y: at + 4, "text-anchor": "end" }, `${short(10 ** power)} %`),
      );
    }
    passes.forEach((each, index) => this.element.append(svg("text", { x: x(index), y: HEIGHT - 6, "text-anchor": "middle" }, passName(each.label, index))));
    for (const [name, ink, label] of SERIES) {
      const points = passes.map((each, index) => [x(index), y(Math.max(each[name], 10 ** low))]);
      this.element.append(
        svg("polyline", { points: points.map((point) => point.join(",")).join(" "), class: `pass-line ${ink}` }),
        ...points.map(([cx, cy]) => svg("circle", { cx, cy, r: 3.5, class: `pass-point ${ink}` })),
        svg("text", { x: WIDTH - 64, y: points.at(-1)[1] + 4, class: `pass-label ${ink}` }, label),
      );
    }
  }
}

/** Return a short name: the number of a pass, or what the first play had. */
function passName(label, index) {
  return label.startsWith("pass ") ? label.slice(5) : ["first", "resp."][index] ?? "";
}
