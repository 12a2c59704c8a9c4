"""Which state follows which: pure, total, and never up by itself."""

from enum import Enum, auto
from typing import NamedTuple

from piezod.config.states import State


class Event(Enum):
    """What may happen to a stage: asked for by somebody, or found by the daemon."""

    SELF_TEST_PASSED = auto()
    SELF_TEST_FAILED = auto()
    ARM = auto()
    DISARM = auto()
    RUN = auto()
    """Follow a command in a mode that does without the sensor."""
    RUN_ADAPTIVE = auto()
    """Follow a command in a mode that needs the sensor: adaptive, trimmed."""
    IDENTIFY = auto()
    """Drive a voltage waveform, to identify or to condition."""
    IDENTIFY_DONE = auto()
    HOLD = auto()
    RESUME = auto()
    STOP = auto()
    ESTOP = auto()
    ESTOP_RELEASED = auto()
    """To be told once the safe voltage is reached: FAULT writes nothing."""
    RESET = auto()
    """Told after the register has dropped what it may: `Facts.latched` is what is left."""
    SHUTDOWN = auto()
    """From here on `Facts.shutting_down`."""
    FAULT_HOLD = auto()
    FAULT_RAMP = auto()
    FAULT_BLIND = auto()
    FAULT_CUT = auto()
    """The output is off; where the amplifier cannot do that, tell FAULT_RAMP instead."""
    HOLD_EXPIRED = auto()
    AT_SAFE = auto()
    RAMP_TIMEOUT = auto()
    LINK_BACK = auto()


class Facts(NamedTuple):
    """What decides about an edge besides state and event.

    Attributes:
        output_known: Whether the voltage in force is known on every axis.
        sensor_valid: Whether the samples of every axis concerned may be used.
        adapt_allowed: Whether no fault speaks against adapting.
        model_known: Whether the hysteresis' memory is known.
        latched: Whether a fault is latched that only `reset` ends (L2 or L3, HOLD or worse).
        resumable: Whether nothing speaks against `resume`.
        shutting_down: Whether the daemon is on its way out.
        estop_active: Whether the emergency stop is still pressed.
        no_entry: Why nothing may be started now, for people; empty where it may.
        was_running: Whether HOLD came from RUN: `resume` leads back there, else to READY.
        self_tested: Whether the self-test has been passed since the process started.
    """

    output_known: bool
    sensor_valid: bool
    adapt_allowed: bool
    model_known: bool
    latched: bool
    resumable: bool
    shutting_down: bool
    estop_active: bool
    no_entry: str = ""
    was_running: bool = True
    self_tested: bool = True


class Step(NamedTuple):
    """What becomes of an event.

    Attributes:
        state: The state from now on; the one before where the event is refused or changes nothing.
        refusal: Why a request is refused and what would help; empty where it is carried out.
    """

    state: State
    refusal: str = ""
