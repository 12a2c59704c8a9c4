"""Finds the zero of the sensors: the mean of what they show while the stage rests."""

from collections.abc import Sequence

from piezod.devices.interface import Sample


class Zeroing:
    """Takes the mean displacement of some axes over some cycles.

    Args:
        axes: Indexes of the axes.
        n_axes: Number of all axes.
        cycles: Valid samples of each axis to take.
        until_ns: When to give up.
    """

    def __init__(self, axes: Sequence[int], n_axes: int, cycles: int, until_ns: int) -> None:
        self.axes, self._cycles, self.until_ns = tuple(axes), cycles, until_ns
        self._sums_um, self._counts = [0.0] * n_axes, [0] * n_axes

    def take(self, samples: Sequence[Sample]) -> bool:
        """Take the samples of a cycle; return whether there are enough; call it in the loop."""
        for axis in self.axes:
            if samples[axis].valid and self._counts[axis] < self._cycles:
                self._sums_um[axis] += samples[axis].position_um
                self._counts[axis] += 1
        return all(self._counts[axis] >= self._cycles for axis in self.axes)

    def mean_um(self, axis: int) -> float:
        """Return the mean of an axis, in µm; once there are enough."""
        return self._sums_um[axis] / self._cycles
