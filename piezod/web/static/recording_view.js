/** The viewer of one recording: two columns over time, marks, and position against drive. */

import { button } from "./command_card.js";
import { el, setText } from "./dom.js";
import { duration, short } from "./format.js";
import { BandChart, columnLabel } from "./recording_chart.js";
import { dateText, downloadLink, exportLinks, insideText } from "./recording_list.js";
import { LoopChart } from "./recording_loop.js";
import { MarkList } from "./recording_marks.js";
import { Span } from "./recording_span.js";

const POINTS = 2000;
const AFTER_MS = 60; // a wheel turns in many small steps
const EACH_MS = 2000; // between two looks at a recording in progress

/** Show a recording in an element; return a function that ends it. */
export async function mountView(element, context) {
  const { stage } = context.stage();
  const of = { stage, recording: context.file() };
  element.replaceChildren(el("p", { class: "empty" }, "Opening the recording …"));
  let contents = await context.socket.request({ do: "contents", ...of }).catch(async (error) => {
    // A recording that this user may not read in its folder is copied by the first view of it.
    if (error.code !== "recording" || !error.what.includes("copied")) throw error;
    await context.socket.request({ do: "view", ...of, column: "cycles/late_ns" });
    return context.socket.request({ do: "contents", ...of });
  });
  if (!contents.rows) {
    element.replaceChildren(el("p", { class: "empty" }, "The recording has no cycle yet."));
    return () => {};
  }
  const span = new Span(contents.begin_s, contents.end_s + 1 / contents.rate_hz);
  const chosen = chosenColumns(contents);
  const selects = [0, 1].map((place) => columnSelect(contents, chosen, place));
  const axis = el("select", { "aria-label": "Axis of marks and loop" }, contents.axes.map((name) => el("option", { value: name }, name)));
  const chart = new BandChart(span, contents.rate_hz);
  const loop = new LoopChart();
  const marks = new MarkList(span);
  const about = el("p", { class: "quiet about" });
  const replay = async () => (await import("./replay.js")).open(context, of.recording, contents.axes);
  const range = el("output", { class: "numbers", "aria-live": "off" });
  element.replaceChildren(
    el(
      "div", { class: "viewer-head" }, el("nav", { "aria-label": "Back" }, el("a", { href: `#/stage/${encodeURIComponent(stage)}/recordings` }, "All recordings")),
      el("div", { class: "buttons" }, downloadLink(stage, of.recording), exportLinks(stage, of.recording, context.me().tables), button("Replay…", replay)),
    ),
    el("h1", {}, of.recording), about,
    el(
      "div", { class: "toolbar", role: "group", "aria-label": "What is shown" },
      el("label", {}, "Left ", selects[0]), el("label", {}, "Right ", selects[1]),
      contents.axes.length > 1 ? el("label", {}, "Axis ", axis) : null,
      el("span", { class: "zoom" }, span.buttons()), range,
    ),
    chart.figure,
    el("div", { class: "viewer-below" }, loop.figure, marks.figure),
  );
  showAbout();

  let number = 0; // of the newest request: answers of older ones are dropped
  let timer = 0;
  const shown = () => chosen.map((name) => contents.columns.find((each) => each.name === name));

  async function load() {
    number += 1;
    const mine = number;
    const { begin_s, end_s } = span;
    const part = { ...of, begin_s, end_s };
    const ask = (what, more) => context.socket.request({ do: what, ...part, ...more });
    chart.figure.setAttribute("aria-busy", "true");
    try {
      const views = await Promise.all(shown().map(({ name }) => ask("view", { column: name, points: POINTS })));
      if (mine !== number) return;
      chart.show(views, shown(), { begin_s, end_s });
      const [found, rows] = await Promise.all([ask("marks", { axis: axis.value }), ask("loop", { axis: axis.value, points: 4000 })]);
      if (mine !== number) return;
      chart.showMarks(found);
      marks.show(found);
      loop.show(rows);
    } catch (error) {
      if (mine === number) context.notify(error.message, "error");
    } finally {
      if (mine === number) chart.figure.removeAttribute("aria-busy");
    }
  }

  const changed = () => {
    setText(range, `${short(span.begin_s)} to ${short(span.end_s)} s (${spanText(span.end_s - span.begin_s)})`);
    chart.setSpan();
    clearTimeout(timer);
    timer = setTimeout(load, AFTER_MS);
  };
  function showAbout() {
    const begin = new Date(new Date(contents.started_at).getTime() + 1000 * contents.begin_s);
    setText(about, `${dateText(begin)}, ${duration(contents.end_s - contents.begin_s)}: ${insideText(contents)}.`);
  }
  /** Look whether the recording has grown, and show the new part if all of it was shown. */
  async function follow() {
    const grown = await context.socket.request({ do: "contents", ...of }).catch(() => contents);
    if (grown.rows === contents.rows) return;
    contents = grown;
    showAbout();
    span.extend(contents.end_s + 1 / contents.rate_hz);
  }
  span.onChange(changed);
  selects.forEach((select, place) => select.addEventListener("change", () => {
    chosen[place] = select.value;
    changed();
  }));
  axis.addEventListener("change", changed);
  const following = setInterval(() => document.hidden || follow(), EACH_MS);
  changed();
  return () => {
    clearInterval(following);
    clearTimeout(timer);
    number += 1;
    chart.close();
    loop.close();
  };
}

function spanText(seconds) {
  return seconds < 10 ? `${short(seconds)} s` : duration(seconds);
}

/** Return the columns that are shown first: command and position of the first axis. */
function chosenColumns({ axes, columns }) {
  const names = columns.map(({ name }) => name);
  return ["command_um", "position_um"].map((name, place) => {
    const wanted = `axis_${axes[0]}/${name}`;
    return names.includes(wanted) ? wanted : names[place];
  });
}

function columnSelect({ columns }, chosen, place) {
  return el("select", {}, columns.map((column) => el(
    "option", { value: column.name, selected: column.name === chosen[place], title: column.description }, columnLabel(column),
  )));
}
