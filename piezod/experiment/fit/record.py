"""A record of one axis: what identification starts from."""

from dataclasses import dataclass, replace

import numpy as np

from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray

Rows = np.ndarray[tuple[int], np.dtype[np.bool_]]
"""Which samples of a record are meant, shape (n,)."""


@dataclass(frozen=True)
class Record:
    """Recorded data of one axis; arrays of shape (n,), times evenly spaced.

    Attributes:
        t_s: Times, in s.
        drive_v: Voltage in force at these times, in V.
        position_um: Displacement measured at these times, in µm.
        run_in_s: The first seconds, which only carry memory and creep on, and count in no error.
        from_rest: Whether the stage had rested where the record begins.
    """

    t_s: FloatArray
    drive_v: FloatArray
    position_um: FloatArray
    run_in_s: float = 0.0
    from_rest: bool = True

    @property
    def period_s(self) -> float:
        """Time from sample to sample, in s."""
        return float((self.t_s[-1] - self.t_s[0]) / (self.t_s.size - 1))

    def drive_delayed_by(self, delay_s: float) -> FloatArray:
        """Return the voltage that was in force a delay before each sample, in V, shape (n,).

        Before the record begins, its first voltage is assumed.
        """
        return np.interp(self.t_s - delay_s, self.t_s, self.drive_v)

    def counted(self, delay_s: float = 0.0) -> Rows:
        """Return which samples count: those after the run-in whose voltage was recorded.

        Args:
            delay_s: How long the displacement lags behind the voltage, in s.
        """
        counted: Rows = self.t_s - self.t_s[0] >= max(delay_s, self.run_in_s)
        return counted

    def after(self, run_in_s: float) -> "Record":
        """Return the record with its first seconds not counted; longer run-ins stay.

        Raises:
            DataError: If nothing would be left.
        """
        run_in = replace(self, run_in_s=max(run_in_s, self.run_in_s))
        if np.count_nonzero(run_in.counted()) < 2:
            length_s = float(self.t_s[-1] - self.t_s[0])
            message = f"skipping {run_in_s:g} s leaves nothing of a record of {length_s:g} s"
            raise DataError(message)
        return run_in
