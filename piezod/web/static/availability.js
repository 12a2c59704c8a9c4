/** Which commands can be used now, and in words why not. The stage itself decides in the end. */

const ROLES = ["viewer", "operator", "engineer"];
const FOR_ENGINEERS = ["identify", "learn", "scan"];
const WITHOUT_LEASE = ["hold", "stop", "record", "replay"];
/** The states in which a command does something: a hold by a person also ends one that would end by itself. */
const STATES = {
  "arm": ["SAFE"],
  "hold": ["READY", "RUN", "IDENT", "HOLD"],
  "resume": ["HOLD"],
  "reset": ["SAFE", "READY", "RUN", "IDENT", "FAULT"],
  "mode": ["SAFE", "READY", "RUN"],
  "zero": ["SAFE", "READY"],
  "condition": ["READY"],
  "goto": ["READY", "RUN"],
  "wave": ["READY", "RUN"]
};
/** What to do in a state in which a command cannot be used. */
const HELP = {
  BOOT: "wait for the self-test",
  SAFE: "arm first",
  RUN: "stop first",
  IDENT: "wait for the waveform, or stop",
  HOLD: "resume or stop first",
  RAMP: "wait for the safe voltage",
  BLIND: "the amplifier does not answer",
  FAULT: "reset first",
  ESTOP: "wait, then reset",
  STOPPING: "the daemon is ending",
};
/** The same, where a command has nothing to do. */
const NOTHING_TO_DO = {
  arm: { states: ["READY", "RUN", "IDENT"], why: "armed already" },
  hold: { states: ["SAFE", "FAULT"], why: "nothing is driven" },
  resume: { states: ["SAFE", "READY", "RUN", "IDENT"], why: "nothing is held" },
};

/** Return why a page may not send a command, whatever the state is; "" if it may. */
export function barrier(command, context) {
  const { up, status } = context.stage();
  const { client, role } = context.me();
  if (!context.socket.connected) return "no connection to piezod web";
  if (!up || !status) return "the daemon does not answer";
  const needed = FOR_ENGINEERS.includes(command) ? "engineer" : "operator";
  const mine = [role, status.role].filter((each) => ROLES.includes(each)).sort((a, b) => ROLES.indexOf(a) - ROLES.indexOf(b))[0];
  if (mine && ROLES.indexOf(mine) < ROLES.indexOf(needed)) return `needs the role ${needed}; this page has ${mine}`;
  const holder = status.lease?.holder;
  return holder && holder.client !== client && !WITHOUT_LEASE.includes(command) ? `${nameOf(holder)} has the lease` : "";
}

/** Return why a command cannot be used now; "" if the page sees no reason. */
export function objection(command, context) {
  const why = barrier(command, context);
  if (why || !STATES[command]) return why;
  const { state, faults } = context.stage().status;
  if (command === "reset" && state !== "FAULT" && STATES.reset.includes(state)) {
    return faults.some(({ latched }) => latched) ? "" : "no fault is latched";
  }
  if (STATES[command].includes(state)) return "";
  const nothing = NOTHING_TO_DO[command];
  return nothing?.states.includes(state) ? nothing.why : HELP[state];
}

/** Return a client as people see it. */
export function nameOf({ user, client }) {
  return client ? `${user} (${client})` : user;
}
