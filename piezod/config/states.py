"""The states of a stage, by the names in status, logs and records."""

from enum import StrEnum


class State(StrEnum):
    """State of a stage; `control.stage.states` defines the transitions."""

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
    """The last voltage is held after a fault or on request; RAMP follows after a while."""
    RAMP = "RAMP"
    """The voltage ramps to the safe voltage."""
    BLIND = "BLIND"
    """The amplifier does not answer: nothing is sent, the voltage in force is unknown."""
    FAULT = "FAULT"
    """Latched: nothing is written until a reset."""
    ESTOP = "ESTOP"
    """Emergency stop: the voltage goes to the safe voltage and stays there."""
    STOPPING = "STOPPING"
    """The voltage ramps to the safe voltage, then the daemon ends."""
