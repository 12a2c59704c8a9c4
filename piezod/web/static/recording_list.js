/** The list of a stage's recordings: when, how long, how large, and what is inside. */

import { el, setText, withCode } from "./dom.js";
import { clockTime, duration, short, UNKNOWN } from "./format.js";

const EACH_MS = 3000; // between two looks for new recordings
const HEADS = ["Recording", "Begin", "Duration", "Size", "Content", "Keep", "File"];

/** Return the text of a size in bytes. */
export function sizeText(bytes) {
  if (bytes == null) return UNKNOWN;
  const units = ["B", "kB", "MB", "GB"];
  const power = Math.min(3, Math.floor(Math.log10(Math.max(bytes, 1)) / 3));
  return `${short(bytes / 1000 ** power)} ${units[power]}`;
}

/** Return the local date and time of a text of ISO 8601. */
export function dateText(iso) {
  const date = new Date(iso);
  return Number.isNaN(date.getTime()) ? UNKNOWN : `${date.toLocaleDateString("en-CA")} ${clockTime(date)}`;
}

/** Return what a recording has, as a sentence. */
export function insideText(contents) {
  const axes = contents.axes.length === 1 ? `axis ${contents.axes[0]}` : `axes ${contents.axes.join(", ")}`;
  const lost = contents.lost ? `, ${contents.lost} missing` : "";
  return `${axes}, ${contents.rows.toLocaleString("en")} cycles at ${short(contents.rate_hz)} Hz${lost}`;
}

/** Return a link that downloads the file of a recording. */
export function downloadLink(stage, name) {
  const href = `recordings/${encodeURIComponent(stage)}/${encodeURIComponent(name)}`;
  return el("a", { class: "button", href, download: `${name}.h5`, "aria-label": `Download ${name}` }, "Download");
}

const FORMATS = { csv: "Export as CSV", parquet: "Export as Parquet" };

/** Return links to a recording as a table; one that cannot be made is barred, with the reason beside it. */
export function exportLinks(stage, name, barriers) {
  const file = `recordings/${encodeURIComponent(stage)}/${encodeURIComponent(name)}`;
  return Object.entries(FORMATS).map(([ending, text]) => barriers[ending]
    ? [el("a", { class: "button", role: "link", "aria-disabled": "true" }, text), el("span", { class: "why" }, withCode(barriers[ending]))]
    // A refusal has a tab of its own, so that this page stays.
    : el("a", { class: "button", href: `${file}/${ending}`, target: "_blank" }, text));
}

/** Return a box that marks a recording as kept. */
export function keepBox(context, name, kept) {
  const box = el("input", { type: "checkbox", checked: kept, "aria-label": `Keep ${name}` });
  box.addEventListener("change", async () => {
    try {
      await context.call("POST", "/v1/recordings/keep", { name, kept: box.checked });
    } catch (error) {
      box.checked = !box.checked;
      context.notify(error.message, "error");
    }
  });
  return el("label", { class: "keep", title: "A kept recording is not removed to make room" }, box, "Keep");
}

/** Show the list in an element; return a function that ends it. */
export async function mountList(element, context) {
  const stage = context.stage().stage;
  const body = el("tbody");
  const note = el("p", { class: "empty" }, "Reading the list …");
  const rows = new Map(); // name: row with its cells
  let ended = false;
  element.replaceChildren(
    el("h1", {}, "Recordings"),
    el(
      "table", { class: "recordings-table", hidden: true },
      el("caption", { class: "unseen" }, `Recordings of ${stage}, the newest first`),
      el("thead", {}, el("tr", {}, HEADS.map((text) => el("th", { scope: "col", class: text === "Content" && "inside" }, text)))),
      body,
    ),
    note,
  );

  async function look() {
    const { running, recordings } = await context.call("GET", "/v1/recordings");
    const names = new Set();
    const ordered = [];
    if (running) ordered.push({ ...running, name: running.file ?? running.name, inProgress: true });
    ordered.push(...recordings);
    for (const each of ordered) {
      names.add(each.name);
      const known = rows.get(each.name);
      if (!known || known.inProgress !== Boolean(each.inProgress)) rows.set(each.name, newRow(each));
      else if (each.inProgress) known.stale = true;
      setText(rows.get(each.name).size, each.inProgress ? "in progress" : sizeText(each.size_bytes));
    }
    for (const name of [...rows.keys()]) if (!names.has(name)) rows.delete(name);
    const elements = ordered.map((each) => rows.get(each.name).element);
    if (elements.some((each, index) => body.children[index] !== each) || body.children.length !== elements.length) body.replaceChildren(...elements);
    element.querySelector("table").hidden = !ordered.length;
    note.hidden = ordered.length > 0;
    setText(note, "There is no recording. Start one on the page of the stage, or with `piezod record start`.");
    await fill(ordered);
  }

  function newRow({ name, kept, inProgress = false }) {
    const cells = Object.fromEntries(["begin", "length", "size", "inside"].map((key) => [key, el("td", { class: key }, UNKNOWN)]));
    const href = `#/stage/${encodeURIComponent(stage)}/recordings/${encodeURIComponent(name)}`;
    const row = el(
      "tr", { class: inProgress ? "in-progress" : null },
      el("th", { scope: "row" }, el("a", { href }, name)),
      cells.begin, cells.length, cells.size, cells.inside,
      el("td", {}, inProgress || kept === undefined ? null : keepBox(context, name, kept)),
      el("td", {}, inProgress ? null : downloadLink(stage, name)),
    );
    return { element: row, ...cells, inProgress: Boolean(inProgress), stale: true };
  }

  /** Ask for the content of one recording after the other, the newest first. */
  async function fill(ordered) {
    for (const { name } of ordered) {
      const row = rows.get(name);
      if (ended) return;
      if (!row?.stale) continue;
      row.stale = false;
      try {
        const contents = await context.socket.request({ do: "contents", stage, recording: name });
        const first = new Date(new Date(contents.started_at).getTime() + 1000 * (contents.begin_s ?? 0));
        setText(row.begin, dateText(first));
        setText(row.length, contents.rows ? duration(contents.end_s - contents.begin_s) : UNKNOWN);
        setText(row.inside, insideText(contents));
      } catch (error) {
        setText(row.inside, error.what ?? error.message);
      }
    }
  }

  async function keepLooking() {
    while (!ended) {
      // Without a connection the shell says so; the list stays as it was.
      if (!document.hidden) await look().catch((error) => rows.size || setText(note, error.message));
      await new Promise((done) => setTimeout(done, EACH_MS));
    }
  }

  keepLooking();
  return () => (ended = true);
}
