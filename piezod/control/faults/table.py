"""Every fault that a running daemon can find: what is done about it, and who may end it."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Final, Literal, NamedTuple

from piezod.config.faults import Fault
from piezod.units import NS_PER_S

Severity = Literal["info", "warning", "error"]


class Reaction(IntEnum):
    """What is done about a fault; the larger is the worse, and the worst wins."""

    NONE = 0
    """It is counted and shown."""
    WARN = 1
    """It is told; the stage goes on."""
    DEGRADE = 2
    """Adaptive and trimmed axes go on in feedforward, without a jump."""
    HOLD = 3
    """The last voltage is held; after a while, or at a second fault, RAMP."""
    RAMP = 4
    """The voltage goes to the safe one at the ramp's rate."""
    BLIND = 5
    """Nothing is sent until the amplifier answers again; then RAMP from what it reads back."""
    CUT = 6
    """The amplifier switches its output off; where it cannot, RAMP."""


class Latch(IntEnum):
    """What ends a fault."""

    L0 = 0
    """Nothing but its absence for a few cycles."""
    L1 = 1
    """`resume` or `reset`, once it is gone."""
    L2 = 2
    """`reset` by an operator, once it has been gone for a second."""
    L3 = 3
    """`reset` by an engineer, likewise."""


class Source(IntEnum):
    """Where a fault comes from; the smaller is the cause of the larger."""

    LOOP = 0
    BUS = 1
    AMPLIFIER = 2
    SENSOR = 3
    ADAPTATION = 4
    PROCESS = 5
    """Never the consequence of another."""


class Escalation(NamedTuple):
    """What becomes of a fault that stays.

    Attributes:
        cycles: From so many cycles after it appeared
        after_ns: and from so long after it appeared, it has
        reaction: this reaction and
        latch: this latch,
        then: and this next escalation, counted from the same appearance; None: none.
    """

    cycles: int
    after_ns: int
    reaction: Reaction
    latch: Latch
    then: Escalation | None = None


class FaultRule(NamedTuple):
    """One fault.

    Attributes:
        id: Its short name.
        name: What it is, for people.
        source: Where it comes from.
        reaction: What is done when it appears.
        latch: What ends it.
        severity: Of its events.
        remedy: What a person does about it.
        escalation: What becomes of it when it stays; None: nothing more.
    """

    id: Fault
    name: str
    source: Source
    reaction: Reaction
    latch: Latch
    severity: Severity
    remedy: str
    escalation: Escalation | None = None


LOOP, BUS, AMPLIFIER, SENSOR, ADAPTATION, PROCESS = Source
NONE, WARN, DEGRADE, HOLD, RAMP, BLIND, CUT = Reaction
L0, L1, L2, L3 = Latch

# A table reads best with two or three lines a row.
# fmt: off
FAULTS: Final[tuple[FaultRule, ...]] = (
    # Sensor.
    FaultRule(Fault.S1, "sensor value stuck while the stage should move", SENSOR, HOLD, L2, "error",
              "check sensor, cable and controller: the value must change when the stage moves"),
    FaultRule(Fault.S2, "sensor value is not a number", SENSOR, HOLD, L1, "error",
              "check the sensor's interface and its settings"),
    FaultRule(Fault.S3, "sensor value outside its physical range", SENSOR, HOLD, L2, "error",
              "check the sensor's range and calibration, and that the stage is free"),
    FaultRule(Fault.S4, "spike in the sensor value", SENSOR, NONE, L0, "info",
              "where it happens often, look for a loose contact or a disturbance"),
    FaultRule(Fault.S5, "no valid sample", SENSOR, HOLD, L1, "error",
              "check cable, power and light of the sensor", Escalation(0, NS_PER_S, RAMP, L2)),
    FaultRule(Fault.S6, "sample late or repeated", SENSOR, WARN, L0, "warning",
              "lower rate_hz, or make the sensor's filter and bus faster"),
    FaultRule(Fault.S7, "sensor saturated", SENSOR, HOLD, L1, "error",
              "bring the stage back into the sensor's range"),
    FaultRule(Fault.S8, "sensor light lost or weak", SENSOR, HOLD, L1, "error",
              "check fibre, connectors and alignment"),
    FaultRule(Fault.S9, "position does not follow the drive as the model says",
              SENSOR, HOLD, L2, "error",
              "check calibration and sign of the sensor, the load, and the model file",
              Escalation(20, 0, RAMP, L2)),
    FaultRule(Fault.S10, "device is another one, or has another calibration",
              SENSOR, RAMP, L3, "error",
              "connect the device that the configuration names, or configure this one"),
    FaultRule(Fault.S11, "samples in the wrong order", SENSOR, HOLD, L1, "error",
              "look for a second program on the bus; replace the interface"),
    FaultRule(Fault.S12, "sensor noisier than usual", SENSOR, DEGRADE, L0, "warning",
              "look for vibration, light and grounding"),
    FaultRule(Fault.S13, "sensor value stands still; it is not needed now",
              SENSOR, WARN, L0, "warning",
              "check sensor and cable before a mode that needs it"),
    # Amplifier.
    FaultRule(Fault.A1, "amplifier does not acknowledge", AMPLIFIER, BLIND, L1, "error",
              "check power and cable of the amplifier", Escalation(0, NS_PER_S, BLIND, L2)),
    FaultRule(Fault.A2, "amplifier takes only part of a command", AMPLIFIER, BLIND, L1, "error",
              "check cable and load of the bus"),
    FaultRule(Fault.A3, "voltage read back is not the one written", AMPLIFIER, HOLD, L2, "error",
              "check load and calibration of the amplifier, and that nobody turns its knob",
              Escalation(7, 0, RAMP, L2)),
    FaultRule(Fault.A4, "amplifier overloaded", AMPLIFIER, HOLD, L2, "error",
              "lower frequency or amplitude; check the actuator for a short",
              Escalation(9, 0, RAMP, L2)),
    FaultRule(Fault.A5, "a voltage was asked for that is not a number",
              AMPLIFIER, HOLD, L2, "error",
              "this is a mistake in the program: report it, with the flight record"),
    FaultRule(Fault.A6, "drive limited by its range or slew rate for long",
              AMPLIFIER, WARN, L0, "warning",
              "ask for less amplitude or speed, or check the limits"),
    FaultRule(Fault.A7, "amplifier was restarted, or its voltage collapsed",
              AMPLIFIER, BLIND, L2, "error",
              "check the amplifier's power"),
    FaultRule(Fault.A8, "amplifier in local mode or disabled", AMPLIFIER, HOLD, L1, "error",
              "give the amplifier back to remote control"),
    FaultRule(Fault.A9, "amplifier's own watchdog tripped or not to be set",
              AMPLIFIER, BLIND, L2, "error",
              "check the amplifier's timeout and its version"),
    FaultRule(Fault.A10, "amplifier does not read back", AMPLIFIER, NONE, L0, "info",
              "nothing to do: what is written is not verified"),
    FaultRule(Fault.A11, "actuator shorted or open", AMPLIFIER, CUT, L3, "error",
              "check actuator and cable before anything is switched on again"),
    FaultRule(Fault.A12, "voltage read back outside the range", AMPLIFIER, CUT, L3, "error",
              "check the amplifier before anything is switched on again"),
    FaultRule(Fault.A13, "amplifier too hot", AMPLIFIER, CUT, L2, "error",
              "let it cool; check fan and load"),
    # Bus: found by the drivers of buses.
    FaultRule(Fault.B1, "device disconnected", BUS, BLIND, L2, "error",
              "check cable and power"),
    FaultRule(Fault.B2, "device came back under another path", BUS, BLIND, L2, "error",
              "name the port by its stable name (/dev/serial/by-id)"),
    FaultRule(Fault.B3, "bytes on the bus that are no frame", BUS, HOLD, L1, "error",
              "check speed, wiring and termination"),
    FaultRule(Fault.B4, "frames with a wrong checksum", BUS, HOLD, L1, "error",
              "check wiring, shield and termination"),
    FaultRule(Fault.B5, "late replies", BUS, HOLD, L1, "error",
              "lower rate_hz, or the latency of the interface"),
    FaultRule(Fault.B6, "frames repeated or in the wrong order", BUS, HOLD, L2, "error",
              "replace the interface or its driver"),
    FaultRule(Fault.B7, "slow replies", BUS, HOLD, L1, "error",
              "lower rate_hz, or the latency of the interface"),
    FaultRule(Fault.B8, "CAN controller off the bus", BUS, BLIND, L2, "error",
              "check wiring, termination and bit rate"),
    FaultRule(Fault.B9, "CAN frames cannot be sent", BUS, BLIND, L1, "error",
              "check that another node on the bus acknowledges"),
    FaultRule(Fault.B10, "device answers with an exception code", BUS, RAMP, L2, "error",
              "check registers and unit address in the configuration, and the device"),
    FaultRule(Fault.B11, "bus overloaded", BUS, HOLD, L1, "error",
              "find the node that sends so much"),
    FaultRule(Fault.B12, "somebody else sends under our name", BUS, HOLD, L2, "error",
              "find the second master, or change the address"),
    FaultRule(Fault.B13, "connection half open", BUS, BLIND, L1, "error",
              "check network and gateway"),
    FaultRule(Fault.B14, "another program uses the port", BUS, BLIND, L2, "error",
              "stop that program (often ModemManager)"),
    FaultRule(Fault.B15, "thread of a device does not answer", BUS, BLIND, L2, "error",
              "see the log for where it stands; restart the daemon"),
    # Loop.
    FaultRule(Fault.L1, "cycle late, periods skipped", LOOP, NONE, L0, "info",
              "where it happens often: `piezod status` tells what real-time set-up is missing"),
    FaultRule(Fault.L2, "cycles late again and again", LOOP, HOLD, L1, "error",
              "lower rate_hz, or give the loop a processor and real-time priority"),
    FaultRule(Fault.L3, "loop hung", LOOP, RAMP, L2, "error",
              "report it, with the log"),
    FaultRule(Fault.L4, "wall clock was set", LOOP, WARN, L0, "info",
              "nothing to do: the loop does not use it"),
    FaultRule(Fault.L5, "loop stood still: suspended, or its machine paused",
              LOOP, RAMP, L1, "error",
              "forbid sleep and migration while armed"),
    FaultRule(Fault.L6, "garbage collection in the loop", LOOP, WARN, L0, "warning",
              "report it: there should be none"),
    FaultRule(Fault.L7, "loop often late", LOOP, DEGRADE, L1, "warning",
              "lower rate_hz, or take load off the processor"),
    FaultRule(Fault.L8, "memory was not there when it was needed", LOOP, WARN, L0, "warning",
              "free memory, or raise the service's limit"),
    FaultRule(Fault.L9, "real-time privileges missing", LOOP, NONE, L0, "info",
              "install the service, or set rtprio and memlock for this user"),
    # Adaptation.
    FaultRule(Fault.D1, "adaptation makes it worse", ADAPTATION, DEGRADE, L2, "warning",
              "identify the stage anew; check the sensor"),
    FaultRule(Fault.D2, "adaptation gave a value that is not a number",
              ADAPTATION, DEGRADE, L2, "warning",
              "report it, with the flight record"),
    FaultRule(Fault.D3, "adapted weights cannot be inverted", ADAPTATION, DEGRADE, L2, "warning",
              "identify the stage anew"),
    FaultRule(Fault.D4, "too little movement to adapt", ADAPTATION, NONE, L0, "info",
              "nothing to do: it goes on with the movement"),
    FaultRule(Fault.D5, "adapted weights far from the identified ones",
              ADAPTATION, DEGRADE, L1, "warning",
              "identify the stage anew; check the sensor for drift"),
    FaultRule(Fault.D6, "the stage oscillates", ADAPTATION, WARN, L2, "warning",
              "lower the trim's gain; check the delay in the configuration",
              Escalation(0, NS_PER_S // 2, DEGRADE, L2, Escalation(0, NS_PER_S, HOLD, L2))),
    FaultRule(Fault.D7, "sample not fit to learn from", ADAPTATION, NONE, L0, "info",
              "nothing to do: it is left out"),
    FaultRule(Fault.D8, "stored parameters damaged or of another stage",
              ADAPTATION, DEGRADE, L2, "warning",
              "load an older set, or identify anew"),
    FaultRule(Fault.D9, "a change of mode moved the drive", ADAPTATION, NONE, L0, "info",
              "nothing to do: the drive goes over at its slew rate"),
    FaultRule(Fault.D10, "hysteresis memory unknown", ADAPTATION, WARN, L0, "warning",
              "run `piezod condition`: until then positions are less accurate"),
    # Process.
    FaultRule(Fault.P2, "the daemon did not end cleanly last time", PROCESS, RAMP, L2, "error",
              "see the log for why; check that the stage stands well"),
    FaultRule(Fault.P3, "a driver failed", PROCESS, HOLD, L2, "error",
              "report it, with the log"),
    FaultRule(Fault.P4, "the control law failed", PROCESS, HOLD, L2, "error",
              "report it, with the log and the flight record"),
    FaultRule(Fault.P6, "disk full", PROCESS, WARN, L0, "warning",
              "delete recordings; a running recording was closed"),
    FaultRule(Fault.P7, "disk too slow for the recording", PROCESS, WARN, L0, "warning",
              "record to a faster disk; the number of lost cycles is in the file"),
    FaultRule(Fault.P11, "configuration file changed", PROCESS, NONE, L0, "info",
              "run `piezod reload` to use it"),
    FaultRule(Fault.P15, "too many events", PROCESS, NONE, L0, "info",
              "nothing to do: they are summarised"),
    FaultRule(Fault.E1, "emergency stop", PROCESS, RAMP, L2, "error",
              "remove the cause, then `piezod reset`"),
    FaultRule(Fault.H1, "supervisor gone", PROCESS, RAMP, L2, "error",
              "see the log; the loop ends too, and the service starts again"),
)
# fmt: on
"""All faults; the index of a fault is its bit in the masks of a record."""

INDEX: Final = {rule.id: index for index, rule in enumerate(FAULTS)}
"""Id: place in `FAULTS`."""


def mask(ids: Iterable[Fault]) -> int:
    """Return faults as bits."""
    bits = 0
    for fault in ids:
        bits |= 1 << INDEX[fault]
    return bits


def ids(bits: int) -> list[Fault]:
    """Return the ids of faults that are given as bits, in the order of the table."""
    return [rule.id for index, rule in enumerate(FAULTS) if bits >> index & 1]
