"""Movements of user axes, as displacements of the actuators that make them."""

from collections.abc import Sequence
from math import inf, nan
from typing import Final

from piezod.control.reference.motion import Motion, Reference, UnknownFuture
from piezod.coordinates.frame import Frame, Lags
from piezod.coordinates.matrices import times
from piezod.coordinates.paths import outside, share_within

_HALVINGS: Final = 40


class UserPath:
    """One movement of each user axis, over one time. Real-time safe.

    Where an actuator would go beyond its limits, all user axes stop, on the path.

    Args:
        frame: The frame of the stage.
        motions: Movement of each user axis, and the time that it had run at the start, in s.
        low_um: Lowest displacement of each actuator, in µm.
        high_um: Highest displacement of each actuator, in µm.
        lags: What moves each actuator later; empty if nothing does.
    """

    def __init__(
        self,
        frame: Frame,
        motions: Sequence[tuple[Motion, float]],
        low_um: Sequence[float],
        high_um: Sequence[float],
        lags: Lags = (),
    ) -> None:
        self._frame, self.motions, self._lags = frame, motions, lags
        start_um = frame.actuators(self.user(0.0))
        # Creep may have brought an actuator out of its range: from there it may come back.
        self.low_um = [min(pair) for pair in zip(low_um, start_um, strict=True)]
        self.high_um = [max(pair) for pair in zip(high_um, start_um, strict=True)]
        self.stops_s = inf
        """Time at which an actuator is at its limit, in s; infinity if none is known."""
        self.at_limit = -1
        """That actuator."""
        self._inside_s, self._t_s, self._last_um = 0.0, nan, start_um

    @property
    def streamed(self) -> bool:
        """Whether the future of a user axis is unknown."""
        return any(isinstance(each.reference_um, UnknownFuture) for each, _ in self.motions)

    @property
    def duration_s(self) -> float:
        """Time until all movements have ended, in s."""
        return max(motion.duration_s - began_s for motion, began_s in self.motions)

    def user(self, t_s: float) -> list[float]:
        """Return the point of the user axes at a time, in s; the limits are left aside."""
        return [motion.reference_um(t_s + began_s) for motion, began_s in self.motions]

    def actuators(self, t_s: float) -> list[float]:
        """Return the displacements of the actuators at a time, in µm."""
        t_s = min(t_s, self.stops_s)
        if t_s == self._t_s:  # the actuators ask one after the other
            return self._last_um
        point_um = self._frame.actuators(self.user(t_s))
        if t_s > self._inside_s:
            beyond = outside(point_um, self.low_um, self.high_um)
            if beyond is not None:
                self._stop_before(t_s, beyond)
                return self.actuators(self.stops_s)
            self._inside_s = t_s
        self._t_s, self._last_um = t_s, point_um
        return point_um

    def way_um(self, actuator: int, t_s: float) -> float:
        """Return the displacement of an actuator at a time, with what others move later, in µm."""
        return self.actuators(t_s)[actuator] + self.late_um(actuator, t_s)

    def late_um(self, actuator: int, t_s: float) -> float:
        """Return how much farther an actuator has to go, in µm: others move it later.

        The frame takes all couplings as if they had no lag. This is the rest: of setpoints of a
        stream, whose past is not kept, it is 0.
        """
        late_um = 0.0
        for other, share, lag_s in self._lags[actuator] if self._lags else ():
            late_um += share * (self.actuators(t_s)[other] - self._before(t_s - lag_s)[other])
        return late_um

    def _before(self, t_s: float) -> list[float]:
        """Return the displacements at a time, which before the start is mirrored at its point.

        So place and speed have no step where one movement follows another.
        """
        if t_s >= 0.0:
            return self.actuators(t_s)
        pairs = zip(self.actuators(0.0), self.actuators(-t_s), strict=True)
        return [2.0 * start_um - after_um for start_um, after_um in pairs]

    def forget(self) -> None:
        """Evaluate the movements again: a setpoint has changed."""
        self._t_s = nan

    def references(self) -> list[Reference]:
        """Return the displacement of each actuator over time."""
        kind = _StreamedActuator if self.streamed else _Actuator
        return [kind(self, index) for index in range(len(self.low_um))]

    def targets_um(self) -> list[float]:
        """Return where each actuator ends, in µm; NaN if a movement does not end at a position."""
        return self._frame.actuators([motion.target_um for motion, _ in self.motions])

    def _stop_before(self, t_s: float, actuator: int) -> None:
        inside_s = self._inside_s
        for _ in range(_HALVINGS):
            middle_s = 0.5 * (inside_s + t_s)
            point_um = self._frame.actuators(self.user(middle_s))
            beyond = outside(point_um, self.low_um, self.high_um)
            if beyond is None:
                inside_s = middle_s
            else:
                t_s, actuator = middle_s, beyond
        self.stops_s, self.at_limit = inside_s, actuator


class _Actuator:
    """Displacement of one actuator over time."""

    def __init__(self, path: UserPath, index: int) -> None:
        self._path, self._index = path, index

    def __call__(self, t_s: float) -> float:
        return self._path.way_um(self._index, t_s)


class _StreamedActuator(UnknownFuture):
    """The same, of a path whose future is unknown."""

    def __init__(self, path: UserPath, index: int) -> None:
        self._path, self._index = path, index

    def __call__(self, t_s: float) -> float:
        return self._path.way_um(self._index, t_s)


class UserStream:
    """Setpoints of user axes, which are followed on the straight line to the newest one.

    Real-time safe. The slowest user axis or actuator sets the speed, and one that is at its limit
    stops all.

    Args:
        axes: Indices of the user axes that follow the stream.
        start: Point of all user axes.
        steps: Largest step of each user axis in a cycle.
        steps_um: Largest step of each actuator in a cycle, in µm.
    """

    def __init__(
        self,
        axes: Sequence[int],
        start: Sequence[float],
        steps: Sequence[float],
        steps_um: Sequence[float],
    ) -> None:
        self.axes, self._steps, self._steps_um = axes, steps, steps_um
        self.value, self.newest = list(start), list(start)
        """Point that is followed, and the newest setpoint; only those of the axes count."""
        self.limited = False
        """Whether a limit of an actuator kept the last step short."""

    def motion(self, axis: int) -> Motion:
        """Return the movement of a user axis."""
        return Motion(_StreamedAxis(self, axis), 0.0, nan)

    def advance(self, path: UserPath, frame: Frame, t_s: float) -> None:
        """Go on by one cycle. Call once per cycle."""
        way = [0.0] * len(self.value)
        for i in self.axes:
            way[i] = self.newest[i] - self.value[i]
        way_um = times(frame.to_actuators, way)
        share = 1.0
        for each, most in zip((*way, *way_um), (*self._steps, *self._steps_um), strict=True):
            if abs(each) > most:
                share = min(share, most / abs(each))
        here_um = path.actuators(t_s)
        step_um = [share * each for each in way_um]
        within = share_within(here_um, step_um, path.low_um, path.high_um)
        self.limited = within < 1.0
        for i in self.axes:
            self.value[i] += share * within * way[i]
        path.forget()


class _StreamedAxis(UnknownFuture):
    """Position of one user axis that follows a stream; later values are unknown."""

    def __init__(self, stream: UserStream, axis: int) -> None:
        self._of, self._axis = stream, axis

    def __call__(self, _t_s: float) -> float:
        return self._of.value[self._axis]
