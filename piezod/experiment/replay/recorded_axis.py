"""One axis of a recording, cycle by cycle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording.marks import names_of
from piezod.records.recording.reader import RecordedTelemetry


@dataclass(frozen=True)
class RecordedAxis:
    """What an axis did in each recorded cycle; arrays of shape (n,)."""

    t_s: FloatArray  #: Instants of the cycles, in s since the start of the recording.
    t_ns: NDArray[np.int64]  #: The same since the first cycle, in ns.
    sample_ns: NDArray[np.int64]  #: Instants of the samples, in ns since the first cycle.
    position_um: FloatArray  #: Measured position, in µm; NaN if it may not be used.
    command_um: FloatArray  #: Command, in µm; NaN if there was none.
    in_force_v: FloatArray  #: Voltage in force when the sample was taken, in V.
    next_v: FloatArray  #: Voltage in force when the next sample was taken, in V.
    modes: NDArray[np.str_]  #: Mode of each cycle.
    follows: NDArray[np.bool_]  #: Whether the axis followed a command.
    skipped: NDArray[np.int64]  #: Periods that the loop skipped before the cycle.

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Cycles with an error: the axis followed a command, and the sample is valid."""
        return np.asarray(self.follows & np.isfinite(self.position_um))


def recorded_axis(telemetry: RecordedTelemetry, axis: str) -> RecordedAxis:
    """Return one axis of a recording.

    Raises:
        DataError: If the axis never follows a command, or has no sample then.
    """
    cycles, columns = telemetry.cycles, telemetry.axes[axis]
    running = names_of(telemetry, "state", cycles["state"]) == State.RUN.value
    follows = running & np.isfinite(columns["command_um"])
    if not follows.any():
        raise DataError(f"axis {axis} follows no command in this recording; record a movement")
    if not np.any(follows & np.isfinite(columns["position_um"])):
        raise DataError(f"axis {axis} has no valid sample while it follows a command")
    in_force_v = columns["in_force_v"]
    return RecordedAxis(
        t_s=cycles["t_s"],
        t_ns=cycles["t_ns"] - cycles["t_ns"][0],
        sample_ns=columns["sample_ns"] - cycles["t_ns"][0],
        position_um=columns["position_um"],
        command_um=columns["command_um"],
        in_force_v=in_force_v,
        # Not `drive_v`: a write that failed was never in force.
        next_v=np.append(in_force_v[1:], columns["drive_v"][-1:]),
        modes=names_of(telemetry, "mode", columns["mode"]),
        follows=follows,
        skipped=np.diff(cycles["skipped"], prepend=cycles["skipped"][:1]),
    )


def modes_to_replay(recorded: RecordedAxis, mode: Mode | None) -> NDArray[np.str_]:
    """Return the mode to replay in each cycle: the given one, or the recorded ones."""
    return recorded.modes if mode is None else np.full(recorded.modes.shape, mode.value)
