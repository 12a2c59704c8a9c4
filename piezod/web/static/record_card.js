/** Start and stop a recording of every cycle. */

import { objection } from "./availability.js";
import { CommandCard, button } from "./command_card.js";
import { el } from "./dom.js";

const LOOK_EACH_MS = 3000;

/** Return the card, the function that shows each document of the stage, and one that ends it. */
export function recordCard(context) {
  const label = el("input", { type: "text", maxlength: "40", placeholder: "label", "aria-label": "Label of the recording" });
  const start = button("Record", () => send("start", label.value ? { label: label.value } : {}), { class: "record" });
  const stop = button("Stop", () => send("stop", {}), { "aria-label": "Stop recording" });
  const state = el("p", { class: "facts" });
  const card = new CommandCard(
    "Recording",
    el("div", { class: "buttons" }, label, start, stop), state,
  );
  let running = null;
  const send = async (verb, body) => {
    const answer = await card.run(context.call("POST", `/v1/recordings/${verb}`, body));
    if (!answer) return;
    if (verb === "stop") {
      const lost = answer.lost ? `, ${answer.lost} lost` : "";
      context.notify(`Recorded ${answer.records} cycles${lost} as ${answer.name}. ${answer.why}`, "good");
    }
    look();
  };
  const look = async () => {
    if (document.hidden || !context.stage().up) return;
    ({ running } = await context.call("GET", "/v1/recordings").catch(() => ({ running })));
    show();
  };
  const show = () => {
    const on = Boolean(running?.recording);
    const why = objection("record", context);
    card.bar([[start, why || (on ? "a recording is in progress" : "")], [stop, why || (on ? "" : "nothing is recorded")]], why);
    stop.classList.toggle("primary", on);
    state.classList.toggle("recording", on);
    const cycles = on ? `${running.records.toLocaleString("en-GB")} cycles` : "";
    state.textContent = on ? `● recording ${running.name} · ${cycles}` : "no recording in progress";
  };
  show();
  look();
  const timer = setInterval(look, LOOK_EACH_MS);
  return { card, show, close: () => clearInterval(timer) };
}
