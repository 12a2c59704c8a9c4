"""Where a stage can be at a voltage, whatever its past: between the branches of its widest loop."""

import numpy as np

from piezod.control.law.model import StageModel

_POINTS = 65


class Plausible:
    """The widest loop of an identified stage, as a table; independent of what is learned later.

    Args:
        model: The identified model.
    """

    def __init__(self, model: StageModel) -> None:
        rise = np.linspace(0.0, 1.0, 513)
        drives = model.inverse().run(np.concatenate((rise, rise[::-1])))
        grid = np.linspace(0.0, 1.0, _POINTS)
        up = np.maximum.accumulate(drives[: rise.size])
        down = np.maximum.accumulate(drives[rise.size :][::-1])
        one, other = np.interp(grid, up, rise), np.interp(grid, down, rise)
        self._low: list[float] = np.minimum(one, other).tolist()
        self._high: list[float] = np.maximum(one, other).tolist()
        self._drive_v = model.drive_v

    def bounds(self, low_v: float, high_v: float) -> tuple[float, float]:
        """Return between what a stage is while its drive is between two finite voltages.

        May be called in the loop.

        Returns:
            Lowest and highest displacement without creep, in units of the model's range.
        """
        return self._at(low_v, self._low), self._at(high_v, self._high)

    def _at(self, drive_v: float, table: list[float]) -> float:
        place = min(max(self._drive_v.to_unit(drive_v), 0.0), 1.0) * (_POINTS - 1)
        index = min(int(place), _POINTS - 2)
        return table[index] + (table[index + 1] - table[index]) * (place - index)
