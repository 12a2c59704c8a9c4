/** Go to a position: by a number, a slider that drags the set-point, and steps. */

import { objection } from "./availability.js";
import { CommandCard, NewestOnly, button } from "./command_card.js";
import { el, field } from "./dom.js";
import { fixed } from "./format.js";
import { niceStep } from "./signals.js";

const STEPS_UM = ["0.01", "0.1", "1", "5"];
const LARGER = 10; // times the step, with Shift
const SLIDER_EACH_MS = 50;
const KEYS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 };

/** Return the card, and the function that shows each document of the stage. */
export function positionCard(context, axis) {
  const go = (position_um) => {
    const body = { position_um, axis: axis.name() };
    if (speed.value) body.speed_um_per_s = Number(speed.value);
    return card.run(context.call("POST", "/v1/goto", body));
  };
  const number = el("input", { type: "number", step: "any", required: true, value: "0" });
  const speed = el("input", { type: "number", step: "any", min: "0" });
  const submit = el("button", { type: "submit", class: "primary" }, "Go");
  const form = el("form", { class: "fields" }, field("Position", number, "µm"), field("Speed", speed, "µm/s"), submit);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    jogged = null;
    go(Number(number.value));
  });

  const slider = el("input", { type: "range", "aria-label": "Set-point", step: "any" });
  const shown = el("span", { class: "slider-value", "aria-hidden": "true" });
  const ends = [el("span", { class: "quiet" }), el("span", { class: "quiet" })];
  const dragged = new NewestOnly(go, SLIDER_EACH_MS);
  slider.addEventListener("input", () => {
    jogged = null;
    say(Number(slider.value));
    dragged.put(Number(slider.value));
  });

  let jogged = null; // the position of the last step, which the stage may not have reached
  const jogs = new NewestOnly(go, SLIDER_EACH_MS);
  const step = el("select", { "aria-label": "Step" }, STEPS_UM.map((each) => el("option", { selected: each === "1" }, each)));
  const jog = (sign, event) => {
    const step_um = Number(step.value);
    const { target_um, position_um } = axis.newest() ?? {};
    // From a measured position to a multiple of the step, because its noise is no place to start from.
    const near_um = position_um == null ? null : step_um * Math.round(position_um / step_um);
    const from_um = jogged ?? target_um ?? near_um;
    if (from_um == null) {
      card.say("The position is not known; go to a position first.");
      return;
    }
    const [low, high] = axis.range_um() ?? [-Infinity, Infinity];
    const wanted_um = from_um + sign * step_um * (event.shiftKey ? LARGER : 1);
    jogged = Math.min(high, Math.max(low, Number(wanted_um.toFixed(6))));
    say(jogged);
    slider.value = jogged;
    jogs.put(jogged);
  };
  const down = button("−", (event) => jog(-1, event), { "aria-label": "One step down", "aria-keyshortcuts": "ArrowLeft ArrowDown" });
  const up = button("+", (event) => jog(1, event), { "aria-label": "One step up", "aria-keyshortcuts": "ArrowRight ArrowUp" });
  const jogGroup = el(
    "div", { class: "jog", role: "group", "aria-label": "Steps" },
    down, el("span", { class: "with-unit" }, step, el("span", { class: "unit" }, "µm")), up,
    el("span", { class: "hint", title: "With Shift, a step is ten times as large" }, "or arrow keys"),
  );
  jogGroup.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS) || event.target === step) return;
    event.preventDefault();
    if (!objection("goto", context)) jog(KEYS[event.key], event);
  });

  const say = (position_um) => {
    shown.textContent = `${fixed(position_um, 3)} ${axis.unit()}`;
    slider.setAttribute("aria-valuetext", position_um == null ? "no target" : shown.textContent);
  };
  const card = new CommandCard(
    "Position", form,
    el("div", { class: "slider" }, slider, el("div", { class: "ends" }, ends[0], shown, ends[1])), jogGroup,
  );
  const show = () => {
    const range = axis.range_um();
    speed.placeholder = axis.part()?.speed_um_per_s ?? "";
    const why = axis.moved() || objection("goto", context);
    card.bar([submit, slider, down, up].map((control) => [control, why || (range ? "" : "the range is not known yet")]), why);
    if (!range) return;
    [slider.min, slider.max] = range;
    slider.step = niceStep((range[1] - range[0]) / 2000); // `any` has no steps for the keyboard
    range.forEach((each, index) => (ends[index].textContent = `${fixed(each, 1)} ${axis.unit()}`));
    const { target_um = null, position_um = null } = axis.newest() ?? {};
    if (jogged != null && target_um === jogged) jogged = null; // the stage has taken it
    if (document.activeElement === slider || jogged != null) return;
    slider.value = target_um ?? position_um ?? range[0];
    say(target_um);
  };
  return { card, show };
}
