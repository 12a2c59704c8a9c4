/** The shell: the stages of this machine, the page that the address names, and the connection. */

import { el, setText } from "./dom.js";
import { startEstop } from "./estop.js";
import { clockTime } from "./format.js";
import { announce, notify } from "./notices.js";
import { Socket } from "./socket.js";
import { mount as mountOverview } from "./overview.js";
import { mount as mountRecordings } from "./recordings.js";
import { mount as mountStage } from "./stage.js";
import { startTheme } from "./theme.js";

const RATE_HZ = 30;

const page = Object.fromEntries(
  ["stages", "tabs", "link", "theme", "estop", "main", "skip"].map((id) => [id, document.getElementById(id)]),
);
const socket = new Socket();
const stages = new Map(); // STAGE documents by name
const handlers = new Set(); // of the mounted page: called with each change of its stage
let route = { name: "", view: "overview", file: "" };
let watched = ""; // name of the stage whose telemetry arrives
let me = { client: "", role: "", tables: {} }; // this tab, as the server knows it
let shows = 0; // how often a page was shown
let mounted = null; // promise of the function that ends the mounted page

/** What a page and the dialogs get to work with. */
const context = {
  socket,
  notify,
  /** Return the STAGE document of the stage that is shown: `stage` (its name), `up`, `since`, `status`. */
  stage: () => stages.get(route.name) ?? { stage: route.name, up: false, since: null, status: null },
  stages: () => [...stages.values()],
  /** This tab: `client`, its name for the lease, `role`, the largest that it may use, and why `tables` of a format cannot be made. */
  me: () => me,
  /** The recording that the address names, or "". */
  file: () => route.file,
  /** Send a request of the public HTTP interface to the stage; return a promise of its document. */
  call: (method, path, body) => socket.request({ do: "call", stage: route.name, method, path, body }),
  /** Call a handler with each change of the stage's document; return a function that ends this. */
  onStage: (handler) => {
    handlers.add(handler);
    return () => handlers.delete(handler);
  },
};

/** Return the parts of an address: `#/stage/NAME`, `…/recordings` and `…/recordings/FILE`. */
function parsed(hash) {
  const [kind, name = "", view = "", file = ""] = hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  if (kind !== "stage" || !name) return { name: "", view: "overview", file: "" };
  return { name, view: view === "recordings" ? "recordings" : "stage", file };
}

async function show() {
  shows += 1;
  const [number, before] = [shows, mounted];
  route = parsed(location.hash);
  handlers.clear();
  mounted = null;
  (await before)?.();
  if (number !== shows) return; // the address has changed again meanwhile
  document.title = route.name ? `${route.name} · piezod` : "piezod";
  const element = el("div", { class: `page ${route.view}` });
  page.main.replaceChildren(element);
  showStages();
  showTabs();
  const mount = { overview: mountOverview, stage: mountStage, recordings: mountRecordings }[route.view];
  mounted = Promise.resolve(mount(element, context)).catch((error) => {
    element.replaceChildren(el("p", { class: "empty" }, error.message));
    if (!error.code) throw error; // a mistake in the page itself
    return null;
  });
  watch();
}

/** Show the pages of the stage as links. */
function showTabs() {
  const link = (text, view, end) => el(
    "a", { href: `#/stage/${encodeURIComponent(route.name)}${end}`, "aria-current": route.view === view && "page" }, text,
  );
  page.tabs.replaceChildren(...(route.name ? [link("Stage", "stage", ""), link("Recordings", "recordings", "/recordings")] : []));
}

function showStages() {
  const links = context.stages().map(({ stage, up, status }) => {
    const state = up ? status?.state ?? "…" : "away";
    return el(
      "a", { href: `#/stage/${encodeURIComponent(stage)}`, "aria-current": stage === route.name && "true" },
      el("span", { class: "dot", "data-state": state }), stage, el("span", { class: "state-name" }, state),
    );
  });
  page.stages.replaceChildren(...links);
}

/** Ask for telemetry of the stage that is shown, and for none if nobody sees it. */
async function watch() {
  const wanted = route.view === "stage" && !document.hidden ? route.name : "";
  if (wanted === watched || !socket.connected) return;
  watched = wanted;
  try {
    if (wanted) take(await socket.request({ do: "watch", stage: wanted, rate_hz: RATE_HZ }));
    else await socket.request({ do: "unwatch" });
  } catch (error) {
    watched = "";
    if (error.code !== "no_connection" && error.code !== "not_found") notify(error.message, "error");
  }
}

/** Take a new document of a stage, or a part of one. */
function take(change) {
  const { event, ...values } = change;
  const stage = { status: null, ...stages.get(change.stage), ...values };
  stages.set(change.stage, stage);
  showStages();
  if (change.stage === route.name || route.view === "overview") for (const handler of [...handlers]) handler(stage, change);
}

async function list() {
  const { stages: found, ...tab } = await socket.request({ do: "stages" });
  me = tab;
  for (const stage of found) take(stage);
  if (!location.hash && found.length === 1) location.replace(`#/stage/${encodeURIComponent(found[0].stage)}`);
  watch();
}

function showLink(text, up) {
  setText(page.link, text);
  page.link.dataset.up = up ? "yes" : "no";
}

socket.on("open", () => {
  showLink("connected", true);
  watched = "";
  list().catch((error) => notify(error.message, "error"));
});
socket.on("close", (since) => {
  const text = `no connection since ${clockTime(since)}`;
  if (page.link.dataset.up === "yes") announce(`Piezod web: ${text}. The page tries again by itself.`, true);
  showLink(text, false);
  // The stages may go on; the page knows nothing of them.
  for (const handler of [...handlers]) handler(context.stage(), { connection: false, since });
});
socket.on("locked", () => showLink("piezod web was started again: open the address that it printed", false));
socket.on("status", take);
socket.on("stage", (event) => {
  take(event);
  if (event.stage === route.name) watch();
});

window.addEventListener("hashchange", show);
document.addEventListener("visibilitychange", watch);
page.skip.addEventListener("click", (event) => {
  event.preventDefault(); // the hash is the address of a page
  page.main.focus();
});
startTheme(page.theme);
startEstop(page.estop, socket, () => (route.name ? [route.name] : [...stages.keys()]));
show();
