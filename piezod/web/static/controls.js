/** The controls of a stage, as cards. The stage decides what is allowed; a card shows its refusal. */

import { barrier, objection } from "./availability.js";
import { CommandCard, button } from "./command_card.js";
import { el } from "./dom.js";
import { positionCard } from "./position_card.js";
import { recordCard } from "./record_card.js";
import { waveCard } from "./wave_card.js";

const MODES = {
  uncompensated: "drive voltage proportional to the command",
  feedforward: "inverse model of the hysteresis, as identified",
  adaptive: "inverse model that learns while the stage moves",
  trimmed: "one of these, and a slow integral of the measured error",
  closed: "adaptive, and a fast feedback of the measured error",
};
const REPORTED_WITHIN_MS = 1500;
/** The button that a person most likely wants in a state. */
const NEXT = { SAFE: "arm", HOLD: "resume", FAULT: "reset", READY: "stop", RUN: "stop", IDENT: "stop" };

/**
 * Return the cards of a stage.
 *
 * @param {object} context That of the page.
 * @param {object} axis The axis that is shown: `name()`, `range_um()`, `newest()`.
 * @returns {{elements: Node[], show: (stage: object) => void, close: () => void}} `show` takes each
 *   document of the stage.
 */
export function controls(context, axis) {
  const cards = [
    powerCard(context), modeCard(context, axis), positionCard(context, axis), waveCard(context, axis),
    recordCard(context),
  ];
  return {
    elements: cards.map(({ card }) => card.element),
    show: (stage) => cards.forEach(({ show }) => show?.(stage)),
    close: () => cards.forEach(({ close }) => close?.()),
  };
}

function powerCard(context) {
  const option = (text) => {
    const box = el("input", { type: "checkbox" });
    return [box, el("label", { class: "check" }, box, text)];
  };
  const [shadow, shadowLabel] = option("Shadow: compute everything, write nothing");
  const [confirm, confirmLabel] = option("I have seen that the output is at its read-back or, without one, at the safe voltage");
  const [engineer, engineerLabel] = option("Reset as engineer");
  const send = (verb, body) => card.run(context.call("POST", `/v1/${verb}`, body?.() ?? {}));
  const buttons = {
    arm: button("Arm", () => send("arm", () => ({ shadow: shadow.checked, confirm_output: confirm.checked }))),
    stop: button("Stop", () => send("stop"), { title: "Ramp to the safe voltage" }),
    hold: button("Hold", () => send("hold"), { title: "Hold the present voltage" }),
    resume: button("Resume", () => send("resume"), { title: "Continue after HOLD" }),
    reset: button("Reset", () => send("reset", () => ({ engineer: engineer.checked })), { title: "Clear faults that are gone" }),
  };
  const card = new CommandCard(
    "Stage",
    el("div", { class: "buttons" }, Object.values(buttons)),
    el("details", {}, el("summary", {}, "Options of Arm and Reset"), shadowLabel, confirmLabel, engineerLabel),
  );
  const show = ({ up, status }) => {
    for (const [verb, each] of Object.entries(buttons)) each.classList.toggle("primary", up && NEXT[status?.state] === verb);
    card.bar(Object.entries(buttons).map(([verb, each]) => [each, objection(verb, context)]), barrier("arm", context));
  };
  return { card, show };
}

function modeCard(context, axis) {
  let asked = { mode: "", until_ms: 0 }; // shown until the stage reports it
  const choose = async (mode) => {
    asked = { mode, until_ms: performance.now() + REPORTED_WITHIN_MS };
    if (!(await card.run(context.call("POST", "/v1/mode", { mode, axis: axis.name() })))) asked.until_ms = 0;
    show(context.stage());
  };
  const radios = Object.entries(MODES).map(([mode, text]) => {
    const input = el("input", { type: "radio", name: "mode", value: mode, onchange: () => choose(mode) });
    return el("label", { class: "choice", title: text }, input, el("span", {}, mode));
  });
  const send = (verb) => card.run(context.call("POST", `/v1/${verb}`, { axis: axis.name() }));
  const zero = button("Zero the sensor", () => send("zero"), { title: "Make the displacement at the rest voltage the sensor zero" });
  const condition = button("Condition", () => send("condition"), { title: "Swing over the whole range, which makes the hysteresis memory known" });
  const card = new CommandCard(
    "Mode",
    el("div", { class: "choices", role: "radiogroup", "aria-label": "Mode" }, radios),
    el("div", { class: "buttons" }, zero, condition),
  );
  const show = ({ status }) => {
    const mode = performance.now() < asked.until_ms ? asked.mode : status?.axes?.[axis.name()]?.mode;
    const inputs = [...card.element.querySelectorAll("input")];
    for (const input of inputs) input.checked = input.value === mode;
    const why = objection("mode", context);
    card.bar([...inputs.map((input) => [input, why]), [zero, objection("zero", context)], [condition, objection("condition", context)]], why);
  };
  return { card, show };
}
