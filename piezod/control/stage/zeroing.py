"""The zero of each sensor: the mean of its samples while the stage rests."""

from collections.abc import Callable, Sequence

from piezod.devices.interface import Sample


class SensorZero:
    """Holds the zeros, and finds new ones.

    Args:
        n_axes: Number of axes.
        apply: Makes the devices count from these zeros, in µm as the sensors show them.
    """

    def __init__(self, n_axes: int, apply: Callable[[Sequence[float]], None]) -> None:
        self._zero_um = [0.0] * n_axes
        self._apply = apply
        self._running: _Mean | None = None
        self.runs = False
        """Whether an average is being taken."""

    def um(self, axis: int) -> float:
        """Return the zero of an axis, in µm as the sensor shows it. Real-time safe."""
        return self._zero_um[axis]

    def set_um(self, axis: int, zero_um: float) -> None:
        """Count the displacement of an axis from another sensor value. Real-time safe."""
        self._zero_um[axis] = zero_um
        self._apply(self._zero_um)

    def begin(self, axes: Sequence[int], cycles: int, until_ns: int) -> None:
        """Begin to average the samples of some axes. Real-time safe.

        Args:
            axes: Indexes of the axes.
            cycles: Number of valid samples of each axis.
            until_ns: Instant at which to give up.
        """
        self._running = _Mean(axes, len(self._zero_um), cycles, until_ns)
        self.runs = True

    def advance(
        self, t_ns: int, samples: Sequence[Sample], *, at_rest: bool
    ) -> Sequence[int] | None:
        """Take the samples of a cycle. Call once per cycle while it runs. Real-time safe.

        Returns:
            The axes that have a new zero; None if zeroing was given up.
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
            self.set_um(axis, self._zero_um[axis] + running.mean_um(axis))
        return running.axes


class _Mean:
    """Averages the displacement of some axes over some cycles."""

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
