"""User axes of a stage: several actuators as one, in coordinates of the user.

Actuators keep their own control law, watches and limits. Here the readings of the sensors become
the displacement of each actuator, a movement of user axes becomes one of all actuators, and the
records of the actuators become those of the user axes.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import inf, nan
from typing import Final

from piezod.config.drive_limits import DriveLimit
from piezod.config.transform import TransformConfig, UserAxisConfig
from piezod.config.waveforms.waveform import Waveform
from piezod.control.reference.motion import (
    PEAK,
    Motion,
    MotionLimits,
    joined,
    lead_in,
    rejoin,
    rest_at,
    smooth_motion,
    waveform_motion,
)
from piezod.control.reference.user_path import UserPath, UserStream
from piezod.control.signals import OnTarget
from piezod.control.stage.axis import StageAxis
from piezod.coordinates.matrices import times
from piezod.coordinates.paths import outside
from piezod.devices.interface import Sample
from piezod.telemetry.record import AxisRecord
from piezod.units import NS_PER_S, s_to_ns

_SAME: Final = 1e-6
_SEVERITY: Final = {DriveLimit.NONE: 0, DriveLimit.SLEW: 1, DriveLimit.RANGE: 2}
_LOOKS: Final = 32
"""Instants at which a movement is looked at before it begins."""


class UserAxes:
    """The user axes of one stage. All methods are real-time safe.

    Args:
        config: Configuration of the user axes, which was accepted.
        axes: All axes of the stage; the owner may replace them.
        period_ns: Period of the loop, in ns.
    """

    def __init__(self, config: TransformConfig, axes: Sequence[StageAxis], period_ns: int) -> None:
        self.names = tuple(config.axes)
        self.units = [axis.unit for axis in config.axes.values()]
        self._axes, self._frame, self._lags = axes, config.frame(), config.lags
        names = [axis.name for axis in axes]
        self.at = [names.index(name) for name in config.actuators]
        """Index of each actuator among the axes."""
        self._period_s, self._period_ns = period_ns / NS_PER_S, period_ns
        self._configs = list(config.axes.values())
        # Only what is not 0: a missing sensor then stops no actuator that does not need it.
        self._mixed = [
            (i, [(j, factor) for j, factor in zip(self.at, row, strict=True) if factor])
            for i, row in zip(self.at, self._frame.from_sensors, strict=True)
        ]
        self._on_target = [_on_target(axis, period_ns) for axis in self._configs]
        self._motions = [(rest_at(nan), 0)] * len(self.names)
        self._numbers = [0] * len(self.names)
        self._path: UserPath | None = None
        self._began_ns, self._of_actuators = 0, list[int]()
        self.stream: UserStream | None = None
        """Setpoints that user axes follow; None if they follow none."""
        self._told_limit = False
        self.crash: Exception | None = None
        """Exception of a cycle, until it is reported."""
        self.commanded_ns = 0
        """Instant of the newest setpoint, in ns."""

    @property
    def actuators(self) -> list[StageAxis]:
        """The actuators, in the order of the configuration."""
        return [self._axes[i] for i in self.at]

    def limits(self, axis: int) -> MotionLimits:
        """Return the limits of the motion of a user axis, in its unit."""
        config, shortest_s = self._configs[axis], 0.0
        for each in self.actuators:
            shortest_s = max(shortest_s, each.motion_limits.shortest_s)
        return MotionLimits(config.speed_per_s, shortest_s, *config.range)

    # ------------------------------------------------------------------ movements

    def line(
        self, points: Sequence[Mapping[int, float]], speed_per_s: float | None, t_ns: int
    ) -> dict[int, Motion]:
        """Return the movements on straight lines through points, with a stop at each.

        Args:
            points: Coordinates of each point by the index of the user axis; axes that a point does
                not name stay.
            speed_per_s: Highest speed of each axis, in its unit; None for the configured one.
            t_ns: Instant of the cycle, in ns.
        """
        here, speeds = self._here(t_ns)
        parts: dict[int, list[Motion]] = {i: [] for point in points for i in point}
        for point in points:
            there = [point.get(i, value) for i, value in enumerate(here)]
            lasts_s = self._lasts_s(here, there, speed_per_s)
            for i, motions in parts.items():
                limits = self.limits(i)._replace(speed_um_per_s=inf, shortest_s=lasts_s)
                motions.append(smooth_motion(here[i], speeds[i], there[i], limits))
            here, speeds = there, [0.0] * len(speeds)
        return {i: joined(motions) for i, motions in parts.items()}

    def waves(
        self, waveforms: Mapping[int, Waveform], duration_s: float, t_ns: int, start_ns: int
    ) -> dict[int, Motion]:
        """Return the movements along waveforms, which all begin at once.

        Arguments as for `StageAxis.follow`; the waveforms are in the units of the user axes.
        """
        here, speeds = self._here(t_ns)
        before = {
            i: lead_in(waveform, here[i], speeds[i], self.limits(i))
            for i, waveform in waveforms.items()
        }
        begins_s = max((start_ns - t_ns) / NS_PER_S, *(each.duration_s for each in before.values()))
        return {
            i: waveform_motion(waveform, duration_s, before[i], begins_s)
            for i, waveform in waveforms.items()
        }

    def lead_in_s(self, waveforms: Mapping[int, Waveform], t_ns: int) -> float:
        """Return how long the ways to the starts of waveforms take, in s."""
        here, speeds = self._here(t_ns)
        return max(
            lead_in(each, here[i], speeds[i], self.limits(i)).duration_s
            for i, each in waveforms.items()
        )

    def refusal(self, motions: Mapping[int, Motion], t_ns: int) -> str:
        """Return why a movement may not begin: where an actuator would go; empty if it may."""
        path = self._planned(motions, t_ns)
        looks = [path.duration_s * look / _LOOKS for look in range(1, _LOOKS + 1)]
        points_um = [self._frame.actuators(path.user(t_s)) for t_s in looks]
        for i, each_um in enumerate(zip(*points_um, strict=True)):
            low_um, high_um = path.low_um[i], path.high_um[i]
            worst_um = max(each_um, key=lambda um: max(low_um - um, um - high_um))
            if outside([worst_um], [low_um], [high_um]) is not None:
                return (
                    f"axis {self.actuators[i].name} would go to {worst_um:.4g} µm, allowed range "
                    f"{low_um:.4g} to {high_um:.4g} µm: move other user axes with it, or less far"
                )
        return ""

    def move(self, motions: Mapping[int, Motion], t_ns: int) -> None:
        """Start movements of some user axes; the others go on with theirs."""
        rest = [i for i in self.stream.axes if i not in motions] if self.stream else []
        streams = self.streams and bool(rest)
        self._move(self._planned(motions, t_ns), motions, t_ns)
        if self.stream is not None and streams:
            self.stream.axes = rest
        else:
            self.stream = None

    def follow_stream(self, axes: Sequence[int], t_ns: int) -> None:
        """Let user axes follow the setpoints of a stream."""
        before = self.stream if self.streams else None
        here, _ = self._here(t_ns)
        steps = [config.speed_per_s * self._period_s for config in self._configs]
        steps_um = [axis.motion_limits.speed_um_per_s * self._period_s for axis in self.actuators]
        all_axes = [*axes, *(i for i in before.axes if i not in axes)] if before else axes
        stream = UserStream(all_axes, here, steps, steps_um)
        if before is not None:
            newest = enumerate(before.newest)
            stream.newest = [here[i] if i in axes else value for i, value in newest]
        motions = {i: stream.motion(i) for i in all_axes}
        self._move(self._planned(motions, t_ns), axes, t_ns)
        self.stream, self.commanded_ns = stream, t_ns

    @property
    def streams(self) -> bool:
        """Whether user axes follow a stream."""
        return self.stream is not None and self._follows()

    def take_setpoint(self, axis: int, value: float, t_ns: int) -> None:
        """Take the newest setpoint of a user axis; one that is not allowed is dropped."""
        if self.stream is not None and self.limits(axis).allow(value):
            self.stream.newest[axis] = value
            self.commanded_ns = max(self.commanded_ns, t_ns)

    def started(self, axes: Sequence[int], t_ns: int) -> tuple[int, float]:
        """Return number and duration of the movement that these user axes have just started."""
        lasts_s = max(self._left_s(i, t_ns) + self._configs[i].settle_s for i in axes)
        return self._numbers[axes[0]], lasts_s

    # ------------------------------------------------------------------ the cycle

    def displacements(self, readings: Sequence[Sample], t_ns: int) -> list[Sample]:
        """Return the displacement of each actuator; other axes keep the reading of their sensor.

        Call once per cycle, first. It is not valid if a sensor that it needs is not.
        """
        try:
            return self._displacements(readings, t_ns)
        except Exception as error:  # noqa: BLE001 - a mistake here must not drop the voltage
            self.crash = error
            return [Sample(each.t_ns, nan, False) for each in readings]

    def _displacements(self, readings: Sequence[Sample], t_ns: int) -> list[Sample]:
        if self.stream is not None and self._path is not None:
            self.stream.advance(self._path, self._frame, (t_ns - self._began_ns) / NS_PER_S)
        samples = list(readings)
        for i, row in self._mixed:
            um, valid = 0.0, True
            for j, factor in row:
                um += factor * readings[j].position_um
                valid = valid and readings[j].valid
            samples[i] = Sample(readings[i].t_ns, um, valid)
        for i, late_um in zip(self.at, self._late_um(t_ns), strict=True):
            if late_um:
                samples[i] = samples[i]._replace(position_um=samples[i].position_um + late_um)
        return samples

    def _late_um(self, t_ns: int) -> list[float]:
        """Return what the actuators go farther now because others move them later, in µm."""
        path = self._path
        if path is None or not self._lags or not self._follows():
            return [0.0] * len(self.at)
        t_s = (t_ns - self._began_ns) / NS_PER_S
        return [path.late_um(i, t_s) for i in range(len(self.at))]

    def records(self, records: Sequence[AxisRecord], t_ns: int) -> list[AxisRecord]:
        """Return the records of the user axes, from those of the axes. Call once per cycle."""
        try:
            return self._records(records, t_ns)
        except Exception as error:  # noqa: BLE001 - a mistake here must not drop the voltage
            self.crash = error
            return [records[i]._replace(position_um=nan, command_um=nan) for i in self.at]

    def _records(self, records: Sequence[AxisRecord], t_ns: int) -> list[AxisRecord]:
        of, late_um = [records[i] for i in self.at], self._late_um(t_ns)
        pairs = list(zip(of, late_um, strict=True))
        positions = self._frame.user([each.position_um - late for each, late in pairs])
        commands = self._frame.user([each.command_um - late for each, late in pairs])
        targets = self._targets([each.target_um for each in of])
        trims = times(self._frame.to_user, [each.trim_um for each in of])
        limited = max([each.limited for each in of], key=_SEVERITY.__getitem__)
        if self.limit_reached(t_ns):
            limited = DriveLimit.RANGE
        found = []
        for i, on_target in enumerate(self._on_target):
            left_s, error = self._left_s(i, t_ns), commands[i] - positions[i]
            # A target that is not a number is that of a stream: it has always arrived.
            far = abs(targets[i] - commands[i]) > self._configs[i].tolerance
            arrived = on_target.update(nan if left_s or far else error)
            found.append(
                AxisRecord(
                    sample_ns=of[0].sample_ns,
                    position_um=positions[i],
                    command_um=commands[i],
                    target_um=targets[i],
                    uncompensated_v=nan,
                    asked_v=nan,
                    drive_v=nan,
                    in_force_v=nan,
                    read_back_v=nan,
                    trim_um=trims[i],
                    mode=of[0].mode,
                    gate=of[0].gate,
                    on_target=arrived,
                    motion=self._numbers[i],
                    limited=limited,
                    remaining_s=left_s if targets[i] == targets[i] else nan,
                )
            )
        return found

    def new_limit(self, t_ns: int) -> str:
        """Return that a limit has stopped the user axes, for people; empty if that was told."""
        reached, told = self.limit_reached(t_ns), self._told_limit
        self._told_limit = reached
        if self._path is None or not reached or told:
            return ""
        at = self._path.at_limit
        which = f": axis {self.actuators[at].name} is at its limit" if at >= 0 else ""
        return f"the user axes have stopped on their path{which}; the next movement goes on"

    def limit_reached(self, t_ns: int) -> bool:
        """Return whether a limit of an actuator has stopped the user axes."""
        path = self._path
        if path is None or not self._follows():
            return False
        stopped = (t_ns - self._began_ns) / NS_PER_S >= path.stops_s
        return stopped or (self.stream is not None and self.stream.limited)

    # ------------------------------------------------------------------ inside

    def _targets(self, of_actuators_um: Sequence[float]) -> list[float]:
        """Return where each user axis ends; NaN if it does not end at a position."""
        if self._follows():
            return [motion.target_um for motion, _ in self._motions]
        return self._frame.user(of_actuators_um)

    def _left_s(self, axis: int, t_ns: int) -> float:
        """Return the time until the movement of a user axis has ended, in s."""
        motion, began_ns = self._motions[axis]
        left_ns = began_ns + s_to_ns(motion.duration_s) - t_ns
        return max(left_ns, 0) / NS_PER_S if self._follows() else 0.0

    def _follows(self) -> bool:
        """Return whether the actuators still follow the movement that was given last."""
        return bool(self._of_actuators) and all(
            axis.following and axis.motion == number
            for axis, number in zip(self.actuators, self._of_actuators, strict=False)
        )

    def _here(self, t_ns: int) -> tuple[list[float], list[float]]:
        """Return point and speed of the user axes, as commanded."""
        pairs = [axis.reference_at(t_ns) for axis in self.actuators]
        late_um = self._late_um(t_ns)
        point = self._frame.user([um - late for (um, _), late in zip(pairs, late_um, strict=True)])
        return point, times(self._frame.to_user, [um_per_s for _, um_per_s in pairs])

    def _lasts_s(
        self, here: Sequence[float], there: Sequence[float], speed_per_s: float | None
    ) -> float:
        """Return how long a straight way takes, at the speed of the slowest axis or actuator."""
        way = [b - a for a, b in zip(here, there, strict=True)]
        way_um = times(self._frame.to_actuators, way)
        speeds = [min(config.speed_per_s, speed_per_s or inf) for config in self._configs]
        speeds += [axis.motion_limits.speed_um_per_s for axis in self.actuators]
        longest_s = self.limits(0).shortest_s
        for each, speed in zip((*way, *way_um), speeds, strict=True):
            longest_s = max(longest_s, PEAK * abs(each) / speed)
        return longest_s

    def _planned(self, motions: Mapping[int, Motion], t_ns: int) -> UserPath:
        """Return the path of new movements, beside those that go on."""
        here, _ = self._here(t_ns)
        goes_on = self._path is not None and self._follows()
        all_motions = [
            (motions[i], 0.0) if i in motions else self._going_on(i, value, t_ns, goes_on=goes_on)
            for i, value in enumerate(here)
        ]
        limits = [axis.motion_limits for axis in self.actuators]
        low_um, high_um = [each.low_um for each in limits], [each.high_um for each in limits]
        return UserPath(self._frame, all_motions, low_um, high_um, self._lags)

    def _going_on(
        self, axis: int, here: float, t_ns: int, *, goes_on: bool
    ) -> tuple[Motion, float]:
        """Return the movement of an axis that gets no new one, and how long it has run, in s."""
        if not goes_on:
            return rest_at(here), 0.0
        motion, began_ns = self._motions[axis]
        elapsed_s = (t_ns - began_ns) / NS_PER_S
        if abs(motion.reference_um(elapsed_s) - here) <= _SAME:
            return motion, elapsed_s
        return rejoin(motion, elapsed_s, here, self.limits(axis)), 0.0

    def _move(self, path: UserPath, begun: Iterable[int], t_ns: int) -> None:
        self._path, self._began_ns = path, t_ns
        # Instants instead of times: each movement goes on when another one begins.
        self._motions = [(motion, t_ns - s_to_ns(began_s)) for motion, began_s in path.motions]
        lasts_s, targets_um = path.duration_s, path.targets_um()
        for axis, reference, target_um in zip(
            self.actuators, path.references(), targets_um, strict=True
        ):
            axis.move(Motion(reference, lasts_s, target_um), t_ns)
        self._of_actuators = [axis.motion for axis in self.actuators]
        for i in begun:
            self._numbers[i] += 1
            self._on_target[i].restart()


def _on_target(config: UserAxisConfig, period_ns: int) -> OnTarget:
    return OnTarget(config.tolerance, s_to_ns(config.settle_s) // period_ns)
