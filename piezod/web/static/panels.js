/** What a stage reports in words and numbers: its state, large values, and its details. */

import { nameOf } from "./availability.js";
import { el, setText } from "./dom.js";
import { clockTime, described, duration, fixed, microns, volts } from "./format.js";
import { announce } from "./notices.js";
import { AXIS, STAGE } from "./shown.js";
import { rms } from "./signals.js";
import { MEANINGS, reason } from "./states.js";

const TEXT_EACH_MS = 100; // nobody reads numbers faster

/** Return the head: name, state with its reason, who has the lease; and a line while the daemon is away. */
export function headPanel(context) {
  const badge = el("span", { class: "badge large", id: "state" });
  const meaning = el("span", { class: "meaning" });
  const lease = el("span", { class: "lease quiet" });
  const title = el("span", { class: "quiet" });
  const away = el("p", { class: "away", hidden: true });
  const element = el(
    "header", { class: "stage-head" },
    el("div", { class: "title-line" }, badge, el("h1", {}, context.stage().stage), title, meaning, lease), away,
  );
  let announced = "";
  const show = ({ stage, up, since, status }, change = {}) => {
    const lost = change.connection === false ? change.since : null;
    showAway(away, stage, up, lost ?? since, lost);
    const state = up ? status?.state ?? "…" : "away";
    setText(badge, state + (status?.shadow ? " · shadow" : ""));
    badge.dataset.state = state;
    const why = up && status ? reason(status) : "";
    setText(meaning, up ? [MEANINGS[state] ?? "", why && `Cause: ${why}.`].filter(Boolean).join(" ") : "");
    setText(title, status?.title ?? "");
    setText(lease, leaseText(status, context.me().client));
    const said = `${stage}: ${state}`;
    if (announced && said !== announced) announce(said);
    announced = said;
  };
  return { element, show };
}

function showAway(away, stage, up, since, lost) {
  away.hidden = up && !lost;
  if (away.hidden) return;
  const what = lost ? "There has been no connection to piezod web" : `The daemon of ${stage} has not answered`;
  const when = since ? ` since ${clockTime(since)} (${duration((Date.now() - new Date(since)) / 1000)})` : "";
  setText(away, `${what}${when}. Values are missing from then on. The page goes on by itself.`);
}

function leaseText(status, client) {
  const holder = status?.lease?.holder;
  if (!status || !("lease" in status)) return "";
  if (!holder) return "lease: free";
  return holder.client === client ? "lease: this page" : `lease: ${nameOf(holder)}`;
}

/** Return the values that a person reads from a distance. */
export function readoutsPanel(view) {
  const tile = (name, ink, unit = AXIS[name].unit) => {
    const output = el("span", { class: "value" }, "–");
    const note = el("span", { class: "note" }, " ");
    const item = el(
      "div", { class: "readout" }, el("dt", {}, el("i", { class: `swatch ${ink}` }), AXIS[name].words, el("span", { class: "unit" }, unit)),
      el("dd", {}, output, note),
    );
    return { item, output, note };
  };
  const tiles = {
    command: tile("command_um", "command"), position: tile("position_um", "position"),
    error: tile("error_um", "error", "nm"), drive: tile("drive_v", "drive"),
  };
  const element = el("dl", { class: "readouts" }, Object.values(tiles).map(({ item }) => item));
  let shown_ms = 0;
  let averaged_ms = 0;
  const draw = () => {
    const now_ms = performance.now();
    if (now_ms - shown_ms < TEXT_EACH_MS) return;
    shown_ms = now_ms;
    const { ring, now_s } = view();
    const newest = ring.newest ?? {};
    setText(tiles.command.output, microns(newest.command_um));
    setText(tiles.position.output, microns(newest.position_um));
    setText(tiles.error.output, fixed(newest.error_um == null ? null : 1000 * newest.error_um, 0));
    setText(tiles.drive.output, volts(newest.drive_v));
    setText(tiles.position.note, newest.on_target ? "on target" : " ");
    setText(tiles.command.note, newest.target_um == null ? " " : `target ${microns(newest.target_um)}`);
    if (now_ms - averaged_ms < 5 * TEXT_EACH_MS) return;
    averaged_ms = now_ms;
    const [errors_um] = ring.samples.since(now_s - 5, ["error_um"]);
    const value = rms(errors_um);
    setText(tiles.error.note, value == null ? " " : `rms ${fixed(1000 * value, 1)} in 5 s`);
  };
  return { element, draw };
}

/** Return a list of facts: each row a name and a value that may change. */
export function facts(rows) {
  const values = {};
  const list = el("dl", { class: "facts-list" }, Object.entries(rows).map(([key, label]) => {
    values[key] = el("dd", {}, "–");
    return [el("dt", {}, label), values[key]];
  }));
  return { list, set: (key, text) => setText(values[key], text) };
}

/** Return what the server says that people see of axis and loop. */
export function detailsPanel(context, axis) {
  const element = el("section", { class: "panel" }, el("h2", {}, "Axis and loop"));
  let list = null;
  const show = ({ up, status }) => {
    const values = status?.axes?.[axis.name()];
    if (!up || !values) return;
    const details = [[AXIS, values], [STAGE, status]].flatMap(([fields, of]) => (
      Object.entries(fields).filter(([, { detail }]) => detail).map(([name, field]) => ({ name, field, value: of[name] }))
    ));
    if (!list) {
      list = facts(Object.fromEntries(details.map(({ name, field }) => [name, field.words])));
      element.append(list.list);
    }
    for (const { name, field, value } of details) list.set(name, described(value, field));
  };
  return { element, show };
}
