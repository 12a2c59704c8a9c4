"""The zero of each sensor: the mean of its samples while the stage rests."""

from collections.abc import Callable, Sequence
from typing import Final

from piezod.devices.interface import Sample
from piezod.units import s_to_ns

ZERO_OVER_S: Final = 0.2
"""Time over which samples are averaged, in s."""


class SensorZero:
    """Stores the sensor zeros and measures new ones. Real-time safe.

    Args:
        n_axes: Number of axes.
        apply: Makes the devices use these zeros, in µm as the sensors show them.
    """

    def __init__(self, n_axes: int, apply: Callable[[Sequence[float]], None]) -> None:
        self._zero_um = [0.0] * n_axes
        self._apply = apply
        self._running: _RunningMean | None = None
        self.runs = False
        """Whether zeroing is in progress."""

    def um(self, axis: int) -> float:
        """Return the zero of an axis, in µm as the sensor shows it."""
        return self._zero_um[axis]

    def set_um(self, axis: int, zero_um: float) -> None:
        """Set the zero of an axis, in µm as the sensor shows it."""
        self._zero_um[axis] = zero_um
        self._apply(self._zero_um)

    def begin(self, axes: Sequence[int], period_ns: int, t_ns: int) -> None:
        """Start to average the samples of some axes, over `ZERO_OVER_S`.

        Zeroing is given up if valid samples are missing after twice that time.

        Args:
            axes: Indices of the axes.
            period_ns: Time between two samples, in ns.
            t_ns: Instant of the cycle, in ns.
        """
        over_ns = s_to_ns(ZERO_OVER_S)
        cycles = max(1, over_ns // period_ns)
        self._running = _RunningMean(axes, len(self._zero_um), cycles, t_ns + 2 * over_ns)
        self.runs = True

    def advance(
        self, t_ns: int, samples: Sequence[Sample], *, at_rest: bool
    ) -> Sequence[int] | None:
        """Take the samples of a cycle. Call once per cycle while `runs`.

        Returns:
            Axes that have a new zero; None if zeroing was given up.
        """
        running = self._running
        if running is None:
            return ()
        given_up = not at_rest or t_ns > running.until_ns
        if not given_up and not running.take(samples):
            return ()
        self._running, self.runs = None, False
        if given_up:
            return None
        for axis in running.axes:
            # The samples count from the present zero, so their mean is the change of the zero.
            self.set_um(axis, self._zero_um[axis] + running.mean_um(axis))
        return running.axes


class _RunningMean:
    """Averages the position of some axes over some cycles."""

    def __init__(self, axes: Sequence[int], n_axes: int, cycles: int, until_ns: int) -> None:
        self.axes, self._cycles, self.until_ns = tuple(axes), cycles, until_ns
        self._sums_um, self._counts = [0.0] * n_axes, [0] * n_axes

    def take(self, samples: Sequence[Sample]) -> bool:
        """Take the samples of a cycle; return whether there are enough."""
        for axis in self.axes:
            if samples[axis].valid and self._counts[axis] < self._cycles:
                self._sums_um[axis] += samples[axis].position_um
                self._counts[axis] += 1
        return all(self._counts[axis] >= self._cycles for axis in self.axes)

    def mean_um(self, axis: int) -> float:
        """Return the mean of an axis, in µm."""
        return self._sums_um[axis] / self._cycles
