/** The emergency stop: a button in reach of every page, and the Escape key pressed twice. */

import { el } from "./dom.js";
import { notify } from "./notices.js";

const TWICE_WITHIN_MS = 800;
const ELSEWHERE = "use the hardware's stop, or `piezod estop` in a terminal";

/**
 * Make a button stop stages.
 *
 * @param {HTMLElement} button The button.
 * @param {Socket} socket The WebSocket.
 * @param {() => string[]} stages Names of the stages to stop: the one that is shown, or else all.
 */
export function startEstop(button, socket, stages) {
  const stop = () => {
    const names = stages();
    if (!names.length) notify(`No stage to stop is known here: ${ELSEWHERE}.`, "error");
    for (const name of names) stopOne(socket, name);
  };
  button.replaceChildren(el("span", {}, "Emergency stop"), el("kbd", {}, "Esc Esc"));
  // A press counts, not its release: a finger that slides off has stopped the stage all the same.
  button.addEventListener("pointerdown", (event) => event.button === 0 && stop());
  button.addEventListener("click", (event) => event.detail === 0 && stop()); // by keyboard
  listenForEscape(stop);
}

async function stopOne(socket, name) {
  try {
    const answer = await socket.request({ do: "estop", stage: name });
    notify(`Emergency stop of ${name}: state ${answer.state}. Reset ends it.`, "info");
  } catch (error) {
    notify(`Emergency stop of ${name} not confirmed: ${error.message}. If it moves, ${ELSEWHERE}.`, "error");
  }
}

function listenForEscape(stop) {
  let last = -Infinity;
  const listener = (event) => {
    if (event.key !== "Escape" || event.repeat) return;
    if (event.timeStamp - last < TWICE_WITHIN_MS) {
      last = -Infinity;
      stop();
    } else {
      last = event.timeStamp;
    }
  };
  // Captured, so that no dialog and no field keeps it.
  window.addEventListener("keydown", listener, { capture: true });
}
