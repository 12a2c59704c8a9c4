"""Watches the sensor of one axis, and says which of its samples may be used.

Detects S1 to S9 and S11 to S13. Some of them are single cycles, some only trip a bucket or a count:
whichever it is, a sample that is wrong is not used in the very cycle in which it comes.
"""

from collections.abc import Sequence
from math import pi
from typing import Final, NamedTuple, Self

from piezod.config.axes import AxisConfig
from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.control.law.model import StageModel
from piezod.control.signals import (
    STILL_SAMPLES,
    STUCK_SAMPLES,
    RecentRange,
    StillSensor,
    StuckSensor,
)
from piezod.control.watch.follow import FollowWatch, Plausible
from piezod.control.watch.screen import EXCESS, SPIKE_SAMPLES, JumpWatch, SampleScreen
from piezod.devices.interface import Sample
from piezod.devices.status import Flags
from piezod.errors import ModelError
from piezod.hysteresis.normalisation import AffineRange
from piezod.units import s_to_ns

ANSWER_NS: Final = 5_000_000
"""What a stage of which no mode is known takes to answer, beyond its delay."""
RINGING_NS: Final = 30_000_000
"""How fast a stage stops ringing, at least: to a third in this time."""
STEP: Final = 0.05
"""A displacement that has jumped to stay, by so much of its range more than can be explained, is
wrong: the sensor has slipped, or something hit the stage."""
STUCK_SWING: Final = 0.02
"""Samples are stuck when the drive moves meanwhile by more than this part of its range."""

_NOTHING: Final[Sequence[Detection]] = ()


class WatchedSensor(NamedTuple):
    """What is known of a sensor and of the stage that it measures.

    Attributes:
        drive_v: Range of the drive.
        position_um: Range of the displacement that belongs to it.
        plausible: Where the stage can be at a voltage; None where there is no model.
        latency_ns: How old a sample is at best, by its time stamp.
        answer_ns: How long after the drive the stage is where it goes, but for ringing.
        ringing_ns: How fast it stops ringing: to a third in this time.
    """

    drive_v: AffineRange
    position_um: AffineRange
    plausible: Plausible | None = None
    latency_ns: int = 0
    answer_ns: int = ANSWER_NS
    ringing_ns: int = RINGING_NS

    @classmethod
    def of(cls, config: AxisConfig, model: StageModel | None) -> Self:
        """Return what a configuration and a model tell.

        Args:
            config: Of the axis.
            model: Its model, counted from the same zero as the samples will be. Without one the
                range of the commands says roughly where the stage can be.

        Raises:
            ModelError: If there is neither.
        """
        drive_v = AffineRange(config.limits.drive_min_v, config.limits.drive_max_v)
        answer_ns, ringing_ns = ANSWER_NS, RINGING_NS
        if mode := config.first_mode:
            answer_ns = s_to_ns(1.0 / mode.frequency_hz)
            fades_ns = s_to_ns(1.5 / (2.0 * pi * mode.frequency_hz * mode.damping))
            ringing_ns = max(ringing_ns, fades_ns)
        if model is not None:
            answer_ns += 2 * s_to_ns(model.delay_s)
            plausible = Plausible(model)
            return cls(drive_v, model.position_um, plausible, 0, answer_ns, ringing_ns)
        if config.command_range_um is None:
            message = "a sensor is watched by a model or by a command range: there is neither"
            raise ModelError(message)
        low_um, high_um = config.command_range_um
        width_um = high_um - low_um
        position_um = AffineRange(low_um - width_um, high_um + width_um)
        return cls(drive_v, position_um, None, 0, answer_ns, ringing_ns)


class SensorWatch:
    """Watches one sensor; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
        sensor: What is known of it.
        period_ns: Period of the loop.
    """

    def __init__(self, axis: int, sensor: WatchedSensor, period_ns: int) -> None:
        self._axis = axis
        self._drive_v, self._position_um = sensor.drive_v, sensor.position_um
        window = -(-sensor.answer_ns // period_ns) + 1
        self._screen = SampleScreen(axis, sensor.position_um, sensor.latency_ns, period_ns)
        self._jumps = JumpWatch(sensor.ringing_ns, period_ns)
        self._follow = FollowWatch(sensor.plausible, window, period_ns)
        self._recent_v = RecentRange(window)
        self._stuck, self._still = StuckSensor(STUCK_SWING), StillSensor()
        self.sample = Sample(0, float("nan"), False)
        """The last sample, to be used downstream: invalid where it may not be."""

    def check(
        self,
        t_ns: int,
        sample: Sample,
        flags: Flags,
        in_force_v: float,
        command_um: float,
        *,
        driven: bool,
        needed: bool,
    ) -> Sequence[Detection]:
        """Return what is wrong with the sensor; call it once in each cycle, after the read.

        May be called in the loop. After it, `sample` is the one to use.

        Args:
            t_ns: Instant of the cycle.
            sample: As the device gave it.
            flags: What the device says is the matter.
            in_force_v: Voltage in force when the sample was taken, NaN where it is not known.
            command_um: Displacement asked for, NaN where there is none.
            driven: Whether this daemon drives the stage. If not, it is free to go anywhere, and may
                not be zeroed yet: S1, S3, S4 and S9 are not judged.
            needed: Whether the sample acts on the drive; where it does not, S13 stands for S1.
        """
        found = self._screen.check(t_ns, sample, flags, driven=driven)
        known = self._take_drive(in_force_v, command_um)
        if not self._screen.usable:
            self._jumps.missed()
            self.sample = Sample(sample.t_ns, sample.position_um, False)
            return found
        self.sample = sample
        position = self._position_um.to_unit(sample.position_um)
        spikes = self._jumps.update(position)
        self._still.update(position)
        if driven and known:
            found = (*found, *self._judge(sample, position, in_force_v, spikes, needed))
        else:
            self._follow.forget()
            self._stuck.forget()
        if self._jumps.excess > EXCESS:
            found = (*found, Detection(Fault.S12, self._axis, self._jumps.excess, EXCESS))
        if self._still.still:
            found = (*found, Detection(Fault.S13, self._axis, self._still.samples, STILL_SAMPLES))
        return found

    @property
    def noise_um(self) -> float:
        """Standard deviation of the sensor's noise."""
        return self._jumps.noise * self._position_um.width

    def _take_drive(self, in_force_v: float, command_um: float) -> bool:
        if in_force_v - in_force_v != 0.0:
            self._recent_v.forget()
            return False
        self._recent_v.add(in_force_v)
        follows = command_um - command_um == 0.0
        wish = (
            self._position_um.to_unit(command_um) if follows else self._drive_v.to_unit(in_force_v)
        )
        self._jumps.move(wish, self._recent_v.swing / self._drive_v.width)
        return True

    def _judge(
        self, sample: Sample, position: float, in_force_v: float, spikes: int, needed: bool
    ) -> Sequence[Detection]:
        axis, width_um = self._axis, self._position_um.width
        if spikes:
            jump_um, allowed_um = self._jumps.jump * width_um, self._jumps.allowed * width_um
            if spikes > SPIKE_SAMPLES and self._jumps.jump > self._jumps.allowed + STEP:
                return (Detection(Fault.S9, axis, jump_um, allowed_um + STEP * width_um),)
            self.sample = Sample(sample.t_ns, sample.position_um, spikes > SPIKE_SAMPLES)
            return (Detection(Fault.S4, axis, jump_um, allowed_um),)
        drive = self._drive_v.to_unit(in_force_v)
        stuck = self._stuck.update(position, drive)
        follow = self._follow
        implausible = follow.update(position, drive, self._recent_v, self._jumps.noise)
        if not (stuck or implausible):
            return _NOTHING
        if stuck:
            fault = Fault.S1 if needed else Fault.S13
            return (Detection(fault, axis, STUCK_SAMPLES, STUCK_SAMPLES),)
        return (Detection(Fault.S9, axis, follow.measured * width_um, follow.limit * width_um),)
