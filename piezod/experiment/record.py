"""A record of one axis: what identification starts from."""

from dataclasses import dataclass

import numpy as np

from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray


@dataclass(frozen=True)
class Record:
    """Recorded data of one axis; arrays of shape (n,), times evenly spaced.

    Attributes:
        t_s: Times, in s.
        drive_v: Voltage in force at these times, in V.
        position_um: Displacement measured at these times, in µm.
    """

    t_s: FloatArray
    drive_v: FloatArray
    position_um: FloatArray

    @property
    def period_s(self) -> float:
        """Time from sample to sample, in s."""
        return float((self.t_s[-1] - self.t_s[0]) / (self.t_s.size - 1))

    def drive_delayed_by(self, delay_s: float) -> FloatArray:
        """Return the voltage that was in force a delay before each sample, in V, shape (n,).

        Before the record begins, its first voltage is assumed.
        """
        return np.interp(self.t_s - delay_s, self.t_s, self.drive_v)

    def aligned(self, delay_s: float) -> "Record":
        """Return the record with each displacement beside the voltage that it answers to.

        The first samples, whose voltage was before the record, are left out.
        """
        known = self.t_s - delay_s >= self.t_s[0]
        drive_v = self.drive_delayed_by(delay_s)
        return Record(self.t_s[known], drive_v[known], self.position_um[known])

    def after(self, skip_s: float) -> "Record":
        """Return the record without its first seconds.

        Raises:
            DataError: If nothing would be left.
        """
        kept = self.t_s - self.t_s[0] >= skip_s
        if np.count_nonzero(kept) < 2:
            length_s = float(self.t_s[-1] - self.t_s[0])
            message = f"skipping {skip_s:g} s leaves nothing of a record of {length_s:g} s"
            raise DataError(message)
        return Record(self.t_s[kept], self.drive_v[kept], self.position_um[kept])
