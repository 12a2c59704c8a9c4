/** The page of one stage: charts, controls, and what the stage reports. */

import { TimeChart } from "./charts.js";
import { el } from "./dom.js";
import { Painter } from "./painter.js";
import { Ring } from "./ring.js";

const CHARTS = [
  {
    title: "Command and displacement", unit: "µm", decimals: 3, least: 0.5, area: "wide",
    series: [{ label: "command", ink: "command", column: "command_um" }, { label: "displacement", ink: "position", column: "position_um" }],
  },
  { title: "Error", unit: "µm", decimals: 3, least: 0.02, series: [{ label: "error", ink: "error", column: "error_um" }] },
  { title: "Drive voltage", unit: "V", decimals: 2, least: 2, series: [{ label: "drive", ink: "drive", column: "drive_v" }] },
];

/** Show a stage in an element; return a function that ends it. */
export function mount(element, context) {
  const painter = new Painter();
  const ring = new Ring();
  const view = () => ({ ring, span_s: 10, now_s: ring.lastTime_s });
  const figures = el("section", { class: "charts", "aria-label": "Charts" });
  for (const options of CHARTS) {
    const chart = new TimeChart(options, view);
    figures.append(chart.figure);
    painter.add(chart);
  }
  element.append(figures);
  const forget = context.socket.on("telemetry", (event) => {
    if (event.stage !== context.stage().stage) return;
    ring.take(event, Object.keys(event.axes)[0]);
    painter.touch();
  });
  return () => {
    forget();
    painter.close();
  };
}
