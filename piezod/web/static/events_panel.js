/** The log of a stage: what this page has seen, and the commands of all clients. */

import { el, withCode } from "./dom.js";
import { clockTime } from "./format.js";

const MOST = 200;
const ASK_AFTER_MS = 400; // a change of the stage
const ASK_EACH_MS = 3000; // some commands change nothing that the status shows
const LONGEST = 140;
const LOOKED_AT = 6; // newest entries that an event may repeat

const logs = new Map(); // name of a stage: its entries, which stay while the tab is open

/** Return the panel: `element`, `show` for each document of the stage and its change, `close`. */
export function eventsPanel(context) {
  const name = context.stage().stage;
  if (!logs.has(name)) logs.set(name, { entries: [], known: new Set(), state: "", faults: [] });
  const log = logs.get(name);
  const list = el("ol", { class: "events", tabindex: "0", "aria-label": "Events, the newest first" });
  const element = el("section", { class: "panel event-panel" }, el("h2", {}, "Events"), list);
  let [timer, due_ms, refused] = [0, Infinity, false];

  const draw = () => list.replaceChildren(...log.entries.map(({ when, text, kind, times }) => el(
    "li", { class: kind }, el("time", { datetime: when.toISOString() }, clockTime(when)),
    el("span", {}, withCode(times > 1 ? `${text} (${times} times)` : text)),
  )));
  const add = (text, kind = "", when = new Date()) => {
    // What repeats is one entry with a number: a fault may come and go many times a second.
    const same = log.entries.slice(0, LOOKED_AT).find((entry) => entry.text === text && kind !== "command");
    if (same) Object.assign(same, { when, times: same.times + 1 });
    else log.entries.push({ when, text, kind, times: 1 });
    log.entries.sort((a, b) => b.when - a.when);
    log.entries.splice(MOST);
  };
  const askAfter = (wait_ms) => {
    const at_ms = performance.now() + wait_ms;
    if (refused || at_ms >= due_ms) return;
    clearTimeout(timer);
    [timer, due_ms] = [setTimeout(ask, wait_ms), at_ms];
  };
  const ask = async () => {
    due_ms = Infinity;
    askAfter(ASK_EACH_MS);
    if (document.hidden || !context.stage().up) return;
    try {
      const { audit } = await context.call("GET", "/v1/audit");
      for (const entry of audit.slice(0, MOST)) addCommand(log, add, entry);
      draw();
    } catch (error) {
      refused = error.code === "not_allowed" || error.code === "forbidden"; // the role has no right to see it
      if (refused) clearTimeout(timer);
    }
  };
  const show = (stage, change = {}) => {
    compare(log, stage, change, add);
    draw();
    askAfter(ASK_AFTER_MS);
  };
  return { element, show, close: () => clearTimeout(timer) };
}

/** Add what has changed: the state, faults, and whether the daemon answers. */
function compare(log, { up, status }, change, add) {
  if (change.event === "stage" && !change.up) add(`the daemon has not answered since ${clockTime(change.since)}`, "bad");
  if (change.missing) add(`the daemon answers; no data from ${clockTime(change.missing.from)} to ${clockTime(change.missing.to)}`, "warn");
  if (change.connection === false && log.state !== "lost") add("no connection to piezod web", "bad");
  if (change.connection === false) log.state = "lost";
  if (!up || !status || change.connection === false) return;
  if (log.state !== status.state) add(log.state && log.state !== "lost" ? `${log.state} to ${status.state}` : `state ${status.state}`, "state");
  log.state = status.state;
  const ids = status.faults.map(({ id }) => id);
  for (const { id, name, latched } of status.faults) if (!log.faults.includes(id)) add(`${id} ${name}`, latched ? "bad" : "warn");
  log.faults = ids;
}

function addCommand(log, add, { when, user, client, what, accepted, why }) {
  const key = `${when} ${what} ${client}`;
  if (log.known.has(key)) return;
  log.known.add(key);
  const plain = what.replace(/[{}']/g, "");
  const text = plain.length > LONGEST ? `${plain.slice(0, LONGEST)} …` : plain;
  const who = client ? `${user} (${client})` : user;
  add(accepted ? `${who}: ${text}` : `${who}: ${text}, refused: ${why}`, accepted ? "command" : "warn", new Date(when));
}
