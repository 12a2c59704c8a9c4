/** The states of a stage in words, as in docs/faults.md. */

export const MEANINGS = {
  BOOT: "Self-test; nothing is written.",
  SAFE: "Not armed: the stage is measured, nothing is written.",
  READY: "Armed: the voltage is held.",
  RUN: "A command is followed.",
  IDENT: "A voltage waveform is driven.",
  HOLD: "The last voltage is held.",
  RAMP: "The voltage goes to the safe voltage.",
  BLIND: "The amplifier does not answer; nothing is sent until it does.",
  FAULT: "Nothing is written. Remove the cause, then Reset.",
  ESTOP: "Emergency stop: the voltage goes to the safe voltage and stays there.",
  STOPPING: "The daemon ends.",
};

/** Return why a stage is in its state: its faults, if it is one that faults lead to. */
export function reason({ state, faults }) {
  if (!["HOLD", "RAMP", "BLIND", "FAULT", "ESTOP"].includes(state)) return "";
  const causes = faults.filter(({ latched }) => latched);
  const shown = causes.length ? causes : faults;
  return shown.map(({ id, name }) => `${id} ${name}`).join("; ");
}
