"""A record of one axis, the input of an identification."""

from dataclasses import dataclass, replace

import numpy as np

from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray

Rows = np.ndarray[tuple[int], np.dtype[np.bool_]]
"""Mask of samples of a record, shape (n,)."""


@dataclass(frozen=True)
class Record:
    """Recorded data of one axis; arrays of shape (n,), evenly in time."""

    t_s: FloatArray  #: Times, in s.
    drive_v: FloatArray  #: Voltage in force at these times, in V.
    position_um: FloatArray  #: Measured position at these times, in µm.
    #: First seconds, which only advance memory and creep, and count in no error.
    run_in_s: float = 0.0
    from_rest: bool = True  #: Whether the stage had rested before the record.
    averaged: int = 1  #: Number of samples that each one is the mean of.

    @property
    def period_s(self) -> float:
        """Sample period, in s."""
        return float((self.t_s[-1] - self.t_s[0]) / (self.t_s.size - 1))

    @property
    def held_s(self) -> float:
        """Time for which the drive held each voltage, in s: until the next was sampled."""
        return self.period_s / self.averaged

    def drive_delayed_by(self, delay_s: float) -> FloatArray:
        """Return the voltage that was in force one delay before each sample, in V, shape (n,).

        Before the record, its first voltage is assumed.
        """
        return np.interp(self.t_s - delay_s, self.t_s, self.drive_v)

    def counted(self, delay_s: float = 0.0) -> Rows:
        """Return the samples that count: those after the run-in whose voltage was recorded.

        Args:
            delay_s: Delay of the displacement behind the voltage, in s; if it is negative, the last
                samples do not count.
        """
        begun = self.t_s - self.t_s[0] >= max(delay_s, self.run_in_s)
        counted: Rows = begun & (self.t_s[-1] - self.t_s >= -delay_s)
        return counted

    def after(self, run_in_s: float) -> "Record":
        """Return the record with at least this run-in.

        Raises:
            DataError: If no samples would remain.
        """
        run_in = replace(self, run_in_s=max(run_in_s, self.run_in_s))
        if np.count_nonzero(run_in.counted()) < 2:
            length_s = float(self.t_s[-1] - self.t_s[0])
            message = f"skipping {run_in_s:g} s leaves nothing of a record of {length_s:g} s"
            raise DataError(message)
        return run_in


def check_varies(drive_v: FloatArray, position_um: FloatArray) -> None:
    """Raise an error for a constant signal, to which nothing can be fitted.

    Args:
        drive_v: (n,) voltages, in V.
        position_um: (n,) positions, in µm.

    Raises:
        DataError: If one of them is constant.
    """
    for name, values in (("drive_v", drive_v), ("position_um", position_um)):
        if not np.ptp(values):
            raise DataError(f"{name} is {values[0]:g} throughout; allowed is a signal that varies")
