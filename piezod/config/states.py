"""The states of a stage, by the names that status, logs and records use."""

from enum import StrEnum


class State(StrEnum):
    """What a running daemon does with its stage; which way leads where: `control.stage.states`."""

    BOOT = "BOOT"
    """Self-test: nothing is written."""
    SAFE = "SAFE"
    """Disarmed: the loop measures, nothing is written."""
    READY = "READY"
    """Armed: the voltage is held."""
    RUN = "RUN"
    """The stage follows a command, in one of the modes."""
    IDENT = "IDENT"
    """A voltage waveform is driven, for identification or conditioning."""
    HOLD = "HOLD"
    """The last voltage is held after a fault or on request; goes on to RAMP after a while."""
    RAMP = "RAMP"
    """The voltage goes to the safe one at the ramp's rate."""
    BLIND = "BLIND"
    """The amplifier does not answer: nothing is sent, what is in force is unknown."""
    FAULT = "FAULT"
    """Latched: nothing is written until a reset."""
    ESTOP = "ESTOP"
    """Emergency stop: to the safe voltage, and no further."""
    STOPPING = "STOPPING"
    """On the way to the safe voltage and out."""
