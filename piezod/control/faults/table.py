"""The faults of a running daemon: the reaction to each, and who may end it.

`docs/faults.md` shows this table; a test compares both.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Final, Literal, NamedTuple

from piezod.config.faults import Fault
from piezod.units import NS_PER_S

Severity = Literal["info", "warning", "error"]


class Reaction(IntEnum):
    """Reaction to a fault. A larger value is more severe, and the most severe reaction wins."""

    NONE = 0
    """The fault is counted and shown."""
    WARN = 1
    """The fault is reported; the stage continues."""
    DEGRADE = 2
    """Axes in a mode that needs the sensor continue in feedforward, without a jump."""
    HOLD = 3
    """The last voltage is held. RAMP follows after a while, or at a second fault."""
    RAMP = 4
    """The voltage goes to the safe voltage at the rate of the safe ramp."""
    BLIND = 5
    """Nothing is sent until the amplifier answers again. Then RAMP from the read-back voltage."""
    CUT = 6
    """The amplifier switches its output off; RAMP if it cannot."""


class Latch(IntEnum):
    """What ends a fault."""

    ITSELF = 0
    """Its absence for a few cycles."""
    RESUME = 1
    """`resume` or `reset`, after the fault is gone."""
    RESET = 2
    """`reset` by an operator, after the fault has been gone for a second."""
    ENGINEER = 3
    """`reset` by an engineer, likewise."""


class FaultSource(IntEnum):
    """Source of a fault. A fault of a smaller source can cause a fault of a larger one."""

    LOOP = 0
    BUS = 1
    AMPLIFIER = 2
    SENSOR = 3
    ADAPTATION = 4
    PROCESS = 5
    """Never the consequence of another source."""


class Escalation(NamedTuple):
    """Change of reaction and latch of a fault that stays.

    It happens when both times have passed since the fault appeared.
    """

    cycles: int  #: Least number of cycles since the fault appeared.
    after_ns: int  #: Least time since the fault appeared, in ns.
    reaction: Reaction  #: The reaction from then on.
    latch: Latch  #: The latch from then on.
    #: The next escalation, counted from the same appearance; None for none.
    then: Escalation | None = None


class FaultRule(NamedTuple):
    """Everything that holds for one fault."""

    id: Fault  #: Short name.
    name: str  #: What the fault is, for people.
    source: FaultSource  #: Source of the fault.
    reaction: Reaction  #: Reaction when the fault appears.
    latch: Latch  #: What ends the fault.
    severity: Severity  #: Severity of its events.
    remedy: str  #: What a person should do.
    #: Change of reaction and latch if the fault stays, which has a latch from the start; None for
    #: none.
    escalation: Escalation | None = None


LOOP, BUS, AMPLIFIER, SENSOR, ADAPTATION, PROCESS = FaultSource
NONE, WARN, DEGRADE, HOLD, RAMP, BLIND, CUT = Reaction
ITSELF, RESUME, RESET, ENGINEER = Latch

# A table is easier to read with two or three lines per row.
# fmt: off
FAULTS: Final[tuple[FaultRule, ...]] = (
    # Sensor.
    FaultRule(Fault.S1, "sensor value stuck while the stage should move",
              SENSOR, HOLD, RESET, "error",
              "check sensor, cable and controller: the value must change when the stage moves"),
    FaultRule(Fault.S2, "sensor value is not a number", SENSOR, HOLD, RESUME, "error",
              "check the sensor's interface and its settings"),
    FaultRule(Fault.S3, "sensor value outside its physical range", SENSOR, HOLD, RESET, "error",
              "check the sensor's range and calibration, and that the stage is free"),
    FaultRule(Fault.S4, "spike in the sensor value", SENSOR, NONE, ITSELF, "info",
              "if it happens often, look for a loose contact or a disturbance"),
    FaultRule(Fault.S5, "no valid sample", SENSOR, HOLD, RESUME, "error",
              "check cable, power and light of the sensor", Escalation(0, NS_PER_S, RAMP, RESET)),
    FaultRule(Fault.S6, "sample late or repeated", SENSOR, WARN, ITSELF, "warning",
              "lower rate_hz, or make the sensor's filter and bus faster"),
    FaultRule(Fault.S7, "sensor saturated", SENSOR, HOLD, RESUME, "error",
              "bring the stage back into the sensor's range"),
    FaultRule(Fault.S8, "sensor light lost or weak", SENSOR, HOLD, RESUME, "error",
              "check fibre, connectors and alignment"),
    FaultRule(Fault.S9, "position does not follow the drive as the model predicts",
              SENSOR, HOLD, RESET, "error",
              "check calibration and sign of the sensor, the load, and the model file",
              Escalation(20, 0, RAMP, RESET)),
    FaultRule(Fault.S10, "device or its calibration is not the configured one",
              SENSOR, RAMP, ENGINEER, "error",
              "connect the device that the configuration names, or configure this one"),
    FaultRule(Fault.S11, "samples in the wrong order", SENSOR, HOLD, RESUME, "error",
              "look for a second program on the bus; replace the interface"),
    FaultRule(Fault.S12, "sensor noisier than usual", SENSOR, DEGRADE, ITSELF, "warning",
              "look for vibration, light and grounding"),
    FaultRule(Fault.S13, "sensor value constant; the present mode does not need it",
              SENSOR, WARN, ITSELF, "warning",
              "check sensor and cable before you use a mode that needs them"),
    # Amplifier.
    FaultRule(Fault.A1, "amplifier does not acknowledge", AMPLIFIER, BLIND, RESUME, "error",
              "check power and cable of the amplifier", Escalation(0, NS_PER_S, BLIND, RESET)),
    FaultRule(Fault.A2, "only part of a write reached the amplifier",
              AMPLIFIER, BLIND, RESUME, "error",
              "check cable and load of the bus"),
    FaultRule(Fault.A3, "read-back voltage differs from the written one",
              AMPLIFIER, HOLD, RESET, "error",
              "check load and calibration of the amplifier, and that its knob is not turned",
              Escalation(7, 0, RAMP, RESET)),
    FaultRule(Fault.A4, "amplifier overloaded", AMPLIFIER, HOLD, RESET, "error",
              "lower frequency or amplitude; check the actuator for a short",
              Escalation(9, 0, RAMP, RESET)),
    FaultRule(Fault.A5, "requested voltage is not a number",
              AMPLIFIER, HOLD, RESET, "error",
              "this is an error in the program: report it, with the flight record"),
    FaultRule(Fault.A6, "drive limited by range or slew rate for a long time",
              AMPLIFIER, WARN, ITSELF, "warning",
              "command less amplitude or speed, or check the limits"),
    FaultRule(Fault.A7, "amplifier was restarted, or its voltage collapsed",
              AMPLIFIER, BLIND, RESET, "error",
              "check the amplifier's power"),
    FaultRule(Fault.A8, "amplifier in local mode or disabled", AMPLIFIER, HOLD, RESUME, "error",
              "give the amplifier back to remote control"),
    FaultRule(Fault.A9, "amplifier's own watchdog tripped, or cannot be set",
              AMPLIFIER, BLIND, RESET, "error",
              "check the amplifier's time-out and firmware version"),
    FaultRule(Fault.A10, "amplifier has no read-back", AMPLIFIER, NONE, ITSELF, "info",
              "nothing to do: written voltages are not verified"),
    FaultRule(Fault.A11, "actuator shorted or open", AMPLIFIER, CUT, ENGINEER, "error",
              "check actuator and cable before you switch anything on again"),
    FaultRule(Fault.A12, "read-back voltage outside the range", AMPLIFIER, CUT, ENGINEER, "error",
              "check the amplifier before you switch anything on again"),
    FaultRule(Fault.A13, "amplifier too hot", AMPLIFIER, CUT, RESET, "error",
              "let it cool; check fan and load"),
    # Bus: found by the drivers of buses.
    FaultRule(Fault.B1, "device disconnected", BUS, BLIND, RESET, "error",
              "check cable and power"),
    FaultRule(Fault.B2, "device came back under another path", BUS, BLIND, RESET, "error",
              "name the port by its stable name (/dev/serial/by-id)"),
    FaultRule(Fault.B3, "bytes on the bus that form no frame", BUS, HOLD, RESUME, "error",
              "check speed and wiring, and the expected replies with `piezod probe --trace`"),
    FaultRule(Fault.B4, "frames with a wrong checksum", BUS, HOLD, RESUME, "error",
              "check wiring, shield and termination"),
    FaultRule(Fault.B5, "late replies", BUS, HOLD, RESUME, "error",
              "lower rate_hz, or the latency of the interface"),
    FaultRule(Fault.B6, "frames repeated or in the wrong order", BUS, HOLD, RESET, "error",
              "look at the bytes with `piezod probe --trace`; replace the interface"),
    FaultRule(Fault.B7, "slow replies", BUS, HOLD, RESUME, "error",
              "lower rate_hz, or the latency of the interface"),
    FaultRule(Fault.B8, "CAN controller off the bus", BUS, BLIND, RESET, "error",
              "check wiring, termination and bit rate"),
    FaultRule(Fault.B9, "CAN frames cannot be sent", BUS, BLIND, RESUME, "error",
              "check that another node on the bus acknowledges"),
    FaultRule(Fault.B10, "device answers with an exception code", BUS, RAMP, RESET, "error",
              "check registers and unit address in the configuration, and the device"),
    FaultRule(Fault.B11, "bus overloaded", BUS, HOLD, RESUME, "error",
              "find the node that sends too much"),
    FaultRule(Fault.B12, "another sender uses the daemon's address", BUS, HOLD, RESET, "error",
              "find the second master, or change the address"),
    FaultRule(Fault.B13, "connection half open", BUS, BLIND, RESUME, "error",
              "check network and gateway"),
    FaultRule(Fault.B14, "another program uses the port", BUS, BLIND, RESET, "error",
              "stop that program (often ModemManager)"),
    FaultRule(Fault.B15, "thread of a device does not respond", BUS, BLIND, RESET, "error",
              "see in the log where it waits; restart the daemon"),
    # Loop.
    FaultRule(Fault.L1, "cycle late, periods skipped", LOOP, NONE, ITSELF, "info",
              "if it happens often, `piezod status` shows which real-time set-up is missing"),
    FaultRule(Fault.L2, "more than a tenth of the cycles lose periods", LOOP, HOLD, ITSELF, "error",
              "lower rate_hz, or give the loop a processor and real-time priority; `piezod check` "
              "shows a quota"),
    FaultRule(Fault.L3, "loop hung", LOOP, RAMP, RESET, "error",
              "report it, with the log"),
    FaultRule(Fault.L4, "wall clock was set", LOOP, WARN, ITSELF, "info",
              "nothing to do: the loop does not use it"),
    FaultRule(Fault.L5, "loop stood still: its process or the machine was suspended",
              LOOP, HOLD, RESUME, "error",
              "prevent sleep and migration of the machine while the stage is armed"),
    FaultRule(Fault.L6, "garbage collection in the loop", LOOP, WARN, ITSELF, "warning",
              "report it: the loop should have none"),
    FaultRule(Fault.L7, "loop often late", LOOP, WARN, ITSELF, "warning",
              "lower rate_hz, or take load off the processor; `piezod check` shows a quota"),
    FaultRule(Fault.L8, "memory not resident when the loop needed it",
              LOOP, WARN, ITSELF, "warning",
              "free memory: end other programs, or add memory to the computer"),
    FaultRule(Fault.L9, "real-time privileges missing", LOOP, NONE, ITSELF, "info",
              "install the service, or set rtprio and memlock for this user"),
    # Adaptation.
    FaultRule(Fault.D1, "adaptation makes the model worse", ADAPTATION, DEGRADE, RESET, "warning",
              "identify the stage again; check the sensor"),
    FaultRule(Fault.D2, "adaptation gave a value that is not a number",
              ADAPTATION, DEGRADE, RESET, "warning",
              "report it, with the flight record"),
    FaultRule(Fault.D3, "adapted weights cannot be inverted", ADAPTATION, DEGRADE, RESET, "warning",
              "identify the stage again"),
    FaultRule(Fault.D4, "too little motion to adapt", ADAPTATION, NONE, ITSELF, "info",
              "nothing to do: adaptation continues with the motion"),
    FaultRule(Fault.D5, "learned model at its bound: it follows the sensor no further",
              ADAPTATION, WARN, ITSELF, "warning",
              "check gain and zero of the sensor; if the stage has changed, identify it again, or "
              "raise learned_pct of its compensator"),
    FaultRule(Fault.D6, "stage oscillates", ADAPTATION, WARN, RESET, "warning",
              "measure the first mode with `piezod response`; lower the gain; check the delay",
              Escalation(0, NS_PER_S // 2, DEGRADE, RESET, Escalation(0, NS_PER_S, HOLD, RESET))),
    FaultRule(Fault.D7, "sample not suitable for learning", ADAPTATION, NONE, ITSELF, "info",
              "nothing to do: it is not used for learning"),
    FaultRule(Fault.D8, "stored parameters damaged or of another stage",
              ADAPTATION, DEGRADE, RESET, "warning",
              "load an older set, or identify again"),
    FaultRule(Fault.D9, "change of mode moved the drive", ADAPTATION, NONE, ITSELF, "info",
              "nothing to do: the drive changes at its slew rate"),
    FaultRule(Fault.D10, "hysteresis memory unknown", ADAPTATION, WARN, ITSELF, "warning",
              "run `piezod condition`: until then positions are less accurate"),
    # Process.
    FaultRule(Fault.P2, "daemon did not end cleanly last time", PROCESS, RAMP, RESET, "error",
              "see the log for the cause; check the stage before you arm it"),
    FaultRule(Fault.P3, "driver failed", PROCESS, HOLD, RESET, "error",
              "report it, with the log"),
    FaultRule(Fault.P4, "control law failed", PROCESS, HOLD, RESET, "error",
              "report it, with the log and the flight record"),
    FaultRule(Fault.P6, "disk full", PROCESS, WARN, ITSELF, "warning",
              "delete recordings; a running recording was closed"),
    FaultRule(Fault.P7, "disk too slow for the recording", PROCESS, WARN, ITSELF, "warning",
              "record to a faster disk; the number of lost cycles is in the file"),
    FaultRule(Fault.P11, "configuration file changed", PROCESS, NONE, ITSELF, "info",
              "run `piezod reload` to use it"),
    FaultRule(Fault.P15, "too many events", PROCESS, NONE, ITSELF, "info",
              "nothing to do: they are summarised"),
    FaultRule(Fault.E1, "emergency stop", PROCESS, RAMP, RESET, "error",
              "remove the cause, then `piezod reset`"),
    FaultRule(Fault.H1, "supervisor gone", PROCESS, RAMP, RESET, "error",
              "see the log; the loop ends too, and the service restarts"),
    # Of later versions: the bits of those before stay.
    FaultRule(Fault.D11, "learned model moves away from the identified one",
              ADAPTATION, WARN, ITSELF, "warning",
              "check gain and zero of the sensor; if the stage has changed, identify it again"),
)
# fmt: on
"""All faults; the index of a fault is its bit in the masks of a record."""

INDEX: Final = {rule.id: index for index, rule in enumerate(FAULTS)}
"""Index in `FAULTS` of each fault."""


def mask(ids: Iterable[Fault]) -> int:
    """Return faults as a bit mask."""
    bits = 0
    for fault in ids:
        bits |= 1 << INDEX[fault]
    return bits


def ids(bits: int) -> list[Fault]:
    """Return the faults of a bit mask, in the order of the table."""
    return [rule.id for index, rule in enumerate(FAULTS) if bits >> index & 1]
