"""Watches the sensor of one axis, and decides which of its samples may be used.

Detects S1 to S9 and S11 to S13. Some faults need one cycle, others a count or a bucket. In either
case a bad sample is dropped in the cycle in which it comes.

S9: if there is a model, the position must lie between the branches of the widest loop, whatever the
past of the stage; a part that relaxes along the path may lead beyond them near the ends. With or
without a model, the position must rise if the drive rises, and fall if it falls, once a stride is
long enough.
"""

from collections.abc import Sequence
from math import copysign, nan, pi
from typing import Final, NamedTuple, Self

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.law.model import StageModel
from piezod.control.signals import (
    STILL_SAMPLES,
    STUCK_SAMPLES,
    RecentRange,
    StillSensor,
    StuckSensor,
)
from piezod.control.watch.screen import EXCESS_FACTOR, SPIKE_SAMPLES, JumpWatch, SampleScreen
from piezod.devices.interface import Sample
from piezod.devices.status import Flags
from piezod.errors import ModelError
from piezod.hysteresis.normalisation import AffineRange
from piezod.units import NS_PER_S, s_to_ns

ANSWER_NS: Final = 5_000_000
"""Response time of a stage whose first mode is unknown, beyond its delay."""
RINGING_NS: Final = 30_000_000
"""Shortest decay time of the ringing, to a third, that is assumed."""
LASTING_JUMP: Final = 0.05
"""A lasting jump that exceeds the allowed one by this share of the range is a fault: the sensor has
slipped, or something hit the stage."""
STUCK_SWING: Final = 0.02
"""Equal samples are stuck if the drive moves meanwhile by more than this share of its range."""

REST_PART: Final = 0.002
"""A drive rests if it has moved by no more than this share of its range."""

_NOTHING: Final[Sequence[Detection]] = ()


_INTERVALS: Final = 64
_LAST: Final = 64.0


class Plausible:
    """The positions that an identified stage can have, as a table that no learning changes.

    Real-time safe.
    """

    def __init__(self, model: StageModel) -> None:
        grid = np.linspace(0.0, 1.0, _INTERVALS + 1)
        low, high = model.form.position_range(model.weights, grid)
        self._low: list[float] = low.tolist()
        self._high: list[float] = high.tolist()
        self._low_v, self._width_v = model.drive_v.low, model.drive_v.width

    def low(self, drive_v: float) -> float:
        """Return the lowest position without creep at this drive, or at a higher one.

        Args:
            drive_v: The drive, finite, in V.

        Returns:
            Position in units of the model's range.
        """
        return self._at(drive_v, self._low)

    def high(self, drive_v: float) -> float:
        """Return the highest position at this drive, or at a lower one, likewise."""
        return self._at(drive_v, self._high)

    def _at(self, drive_v: float, table: list[float]) -> float:
        place = (drive_v - self._low_v) / self._width_v * _LAST
        if place <= 0.0:
            place = 0.0
        elif place >= _LAST:
            place = _LAST
        index = int(place)
        if index == _INTERVALS:
            index -= 1
        return table[index] + (table[index + 1] - table[index]) * (place - index)


MARGIN: Final = 0.1
"""Creep, drift and a load may move a stage this far beyond the widest loop, as a share of the
range. An offset of the sensor or a wrong gain moves it farther."""
OUTSIDE_CYCLES, OUTSIDE_NS = 20, NS_PER_S // 100
"""The position is implausible after this time outside, whichever is longer. Cycles inside count
back."""
STRIDE: Final = 0.02
"""Shortest stride, as a share of the drive's range."""
STRIDE_CYCLES, STRIDE_ANSWERS = 20, 4
"""A stride lasts at least this many cycles, and this many response times of the stage."""
TURNED: Final = 0.002
"""A drive that moves back by this share of its range has turned: a new stride begins."""
AGAINST: Final = 0.005
"""A stride is wrong if the position moves by this share of its range against the drive."""
WRONG_STRIDES: Final = 3
"""This many wrong strides in a row are a fault."""


class FollowWatch:
    """Watches whether one axis follows its drive. Fixed memory. Real-time safe.

    Args:
        plausible: The widest loop; None if there is no model.
        window_cycles: Response time of the stage, in cycles.
        period_ns: Period of the loop, in ns.
    """

    def __init__(
        self,
        plausible: Plausible | None,
        window_cycles: int,
        period_ns: int,
    ) -> None:
        self._plausible = plausible
        self._limit_cycles = max(OUTSIDE_CYCLES, OUTSIDE_NS // period_ns)
        self._outside_cycles = 0
        self._strides = _Strides(max(STRIDE_CYCLES, STRIDE_ANSWERS * window_cycles))
        self.measured, self.limit = 0.0, MARGIN
        """Last distance beyond the widest loop, or against the drive, and its limit; in units of
        the range."""

    def update(self, position: float, drive: float, recent_v: RecentRange, noise: float) -> bool:
        """Take the position of a cycle; return whether it is implausible. Call once per cycle.

        Args:
            position: Credible position, in units of its range.
            drive: Voltage in force, in units of its range.
            recent_v: The voltages in force during the response time.
            noise: Standard deviation of the noise of the position, in units of the range.
        """
        against = self._strides.update(position, drive, noise)
        if self._plausible is not None:
            # Any drive of the response time may explain the position, so take the range over all of
            # them.
            low, high = self._plausible.low(recent_v.low), self._plausible.high(recent_v.high)
            beyond = max(low - position, position - high)
            if beyond <= MARGIN:
                # Leave twice as fast as enter: noise at the limit never adds up to a fault.
                if self._outside_cycles:
                    self._outside_cycles = max(self._outside_cycles - 2, 0)
            else:
                self._outside_cycles = min(self._outside_cycles + 1, self._limit_cycles)
                self.measured, self.limit = beyond, MARGIN
            if self._outside_cycles >= self._limit_cycles:
                return True
        if against:
            self.measured, self.limit = self._strides.against, AGAINST
        return against

    def forget(self) -> None:
        """Start again: the stage is not driven."""
        self._outside_cycles = 0
        self._strides.forget()


class _Strides:
    """Compares the directions of drive and position, stride by stride.

    Args:
        cycles: Shortest duration of a stride.
    """

    def __init__(self, cycles: int) -> None:
        self._min_cycles = cycles
        self.against = 0.0
        """Distance of the last wrong stride against the drive, in units of the range."""
        self.forget()

    def forget(self) -> None:
        """Start again."""
        self._cycles = -1
        self._wrong_strides = 0
        self._start_drive = self._start = self._farthest = 0.0

    def update(self, position: float, drive: float, noise: float) -> bool:
        """Take a cycle; return whether the last strides were wrong."""
        moved = drive - self._start_drive
        way, farthest = abs(moved), abs(self._farthest)
        # A turn back, or across the start of the stride.
        turned = way < farthest - TURNED or moved * self._farthest < 0.0
        rests = self._cycles >= self._min_cycles and farthest < TURNED
        if turned or rests or self._cycles < 0:  # at rest, creep may go either way
            self._begin(position, drive)
            return self._wrong_strides >= WRONG_STRIDES
        self._cycles += 1
        if way > farthest:
            self._farthest = moved
        if way >= STRIDE and self._cycles >= self._min_cycles:
            along = copysign(1.0, moved) * (position - self._start)
            # Both ends of the stride have noise: each may be off by four standard deviations.
            if along < -(AGAINST + 8.0 * noise):
                self._wrong_strides, self.against = (
                    min(self._wrong_strides + 1, WRONG_STRIDES),
                    -along,
                )
            else:
                self._wrong_strides = 0
            self._begin(position, drive)
        return self._wrong_strides >= WRONG_STRIDES

    def _begin(self, position: float, drive: float) -> None:
        """Begin a stride here."""
        self._cycles, self._farthest = 0, 0.0
        self._start_drive, self._start = drive, position


class WatchedSensor(NamedTuple):
    """Properties of a sensor and of the stage that it measures."""

    drive_v: AffineRange  #: Range of the drive, in V.
    position_um: AffineRange  #: Range of the displacement for that drive, in µm.
    #: Positions that are possible at a voltage; None without a model.
    plausible: Plausible | None = None
    latency_ns: int = 0  #: Smallest age of a sample, by its time stamp, in ns.
    #: Time until the stage has followed the drive, ringing left aside, in ns.
    answer_ns: int = ANSWER_NS
    ringing_ns: int = RINGING_NS  #: Decay time of the ringing, to a third, in ns.
    error_um: float = 0.0  #: Worst error of a position of the model, in µm; 0 if unknown.

    @classmethod
    def of(cls, config: AxisConfig, model: StageModel | None) -> Self:
        """Return the properties that follow from a configuration and a model.

        Args:
            config: Configuration of the axis.
            model: Model of the axis, with the same zero as the samples. Without a model, the range
                of the commands shows roughly where the stage can be.

        Raises:
            ModelError: If there is neither a model nor a command range.
        """
        drive_v = AffineRange(config.limits.drive_min_v, config.limits.drive_max_v)
        answer_ns, ringing_ns = ANSWER_NS, RINGING_NS
        if mode := config.first_mode:
            answer_ns = s_to_ns(1.0 / mode.frequency_hz)
            # The amplitude decays as exp(-ζ ω t): after 1.5 time constants to 0.22, below a third.
            fades_ns = s_to_ns(1.5 / (2.0 * pi * mode.frequency_hz * mode.damping))
            ringing_ns = max(ringing_ns, fades_ns)
        if model is not None:
            answer_ns += 2 * s_to_ns(max(model.delay_s, 0.0))
            plausible = Plausible(model)
            return cls(
                drive_v,
                model.position_um,
                plausible,
                answer_ns=answer_ns,
                ringing_ns=ringing_ns,
                error_um=model.error_um,
            )
        if config.command_range_um is None:
            message = "the axis has neither a model nor a command_range_um: set one of them"
            raise ModelError(message)
        # The command range does not define the range of the drive, so allow its width beyond it.
        low_um, high_um = config.command_range_um
        width_um = high_um - low_um
        position_um = AffineRange(low_um - width_um, high_um + width_um)
        return cls(drive_v, position_um, None, 0, answer_ns, ringing_ns)


class SensorWatch:
    """Watches one sensor. Fixed memory. Real-time safe.

    Args:
        axis: Index of the axis, for the detections.
        sensor: Properties of the sensor and of the stage.
        period_ns: Period of the loop, in ns.
    """

    def __init__(self, axis: int, sensor: WatchedSensor, period_ns: int) -> None:
        self._axis = axis
        self._low_v, self._width_v = sensor.drive_v.low, sensor.drive_v.width
        self._low_um, self.width_um = sensor.position_um.low, sensor.position_um.width
        """Lowest position and width of the range of positions, in µm."""
        self.answer_ns = sensor.answer_ns
        """Time until the stage has followed the drive, in ns."""
        self.model_error_um = sensor.error_um
        """Worst error of a position of the model, in µm; 0 without a model."""
        # Cycles of the response time, rounded up, and the present one.
        window = -(-sensor.answer_ns // period_ns) + 1
        self._screen = SampleScreen(axis, sensor.position_um, sensor.latency_ns, period_ns)
        self._jumps = JumpWatch(sensor.ringing_ns, period_ns)
        self._follow = FollowWatch(sensor.plausible, window, period_ns)
        self._plausible, self._recent_v = sensor.plausible, RecentRange(window)
        self._stuck, self._still = StuckSensor(STUCK_SWING), StillSensor()
        self.sample = Sample(0, nan, False)
        """The last sample for use by the control law; marked invalid if it may not be used."""

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
        reading_um: float | None = None,
    ) -> Sequence[Detection]:
        """Return the faults of the sensor. Call once per cycle, after the read.

        Afterwards `sample` is the sample to use.

        Args:
            t_ns: Instant of the cycle, in ns.
            sample: Sample from the device.
            flags: Flags that the device reports.
            in_force_v: Voltage in force when the sample was taken, in V; NaN if it is unknown.
            command_um: Command, in µm; NaN if there is none.
            driven: Whether this daemon drives the stage. If not, the stage may move freely, and its
                sensor may not be zeroed yet: S1, S3, S4 and S9 are not reported.
            needed: Whether the sample acts on the drive. If not, S13 is reported instead of S1.
            reading_um: What the sensor itself shows, in µm, if the sample is made from several
                sensors, which would hide that one is stuck; None if the sample is its reading.
        """
        found = self._screen.check(t_ns, sample, flags, driven=driven)
        known = self._take_drive(in_force_v, command_um)
        if not self._screen.usable:
            self._jumps.missed()
            self.sample = Sample(sample.t_ns, sample.position_um, False)
            return found
        self.sample = sample
        position = (sample.position_um - self._low_um) / self.width_um
        spikes = self._jumps.update(position)
        reading = position
        if reading_um is not None:
            reading = (reading_um - self._low_um) / self.width_um
        self._still.update(reading)
        if driven and known:
            motion = self._check_motion(sample, position, reading, in_force_v, spikes, needed)
            if motion:
                found = (*found, *motion)
        else:
            # Without a drive of ours, or with an unknown one, motion proves nothing.
            self._follow.forget()
            self._stuck.forget()
        excess = self._jumps.excess
        if excess > EXCESS_FACTOR:
            found = (*found, Detection(Fault.S12, self._axis, excess, EXCESS_FACTOR))
        if self._still.still:
            found = (*found, Detection(Fault.S13, self._axis, self._still.samples, STILL_SAMPLES))
        return found

    def zeroed(self) -> None:
        """Note that the samples count from another zero from now on."""
        self._jumps.zeroed()
        self._follow.forget()

    @property
    def ready(self) -> bool:
        """Whether modes that need the sensor may be used."""
        return self.sample.valid

    def allowed_um(self, drive_v: float) -> tuple[float, float]:
        """Return the range of positions that the stage can have at a voltage, whatever its past.

        Returns:
            Lowest and highest position, in µm; NaN without a model or a finite voltage.
        """
        if self._plausible is None or drive_v - drive_v != 0.0:
            return nan, nan
        low, high = self._plausible.low(drive_v) - MARGIN, self._plausible.high(drive_v) + MARGIN
        return self._low_um + low * self.width_um, self._low_um + high * self.width_um

    @property
    def rests(self) -> bool:
        """Whether the drive has hardly moved during the response time."""
        return self._recent_v.swing <= REST_PART * self._width_v

    @property
    def gain_um_per_v(self) -> float:
        """Mean slope of the displacement over the drive, in µm/V; NaN without a model."""
        return nan if self._plausible is None else self.width_um / self._width_v

    @property
    def noise_um(self) -> float:
        """Standard deviation of the sensor noise, in µm."""
        return self._jumps.noise * self.width_um

    def _take_drive(self, in_force_v: float, command_um: float) -> bool:
        """Take the voltage in force; return whether it is known."""
        if in_force_v - in_force_v != 0.0:
            self._recent_v.forget()
            return False
        self._recent_v.add(in_force_v)
        if command_um - command_um == 0.0:
            reference = (command_um - self._low_um) / self.width_um
        else:
            reference = (in_force_v - self._low_v) / self._width_v
        self._jumps.move(reference, self._recent_v.swing / self._width_v)
        return True

    def _check_motion(
        self,
        sample: Sample,
        position: float,
        reading: float,
        in_force_v: float,
        spikes: int,
        needed: bool,
    ) -> Sequence[Detection]:
        """Return the faults of a usable sample while the stage is driven."""
        if spikes:
            axis, width_um = self._axis, self.width_um
            jump_um, allowed_um = self._jumps.jump * width_um, self._jumps.allowed * width_um
            if spikes > SPIKE_SAMPLES and self._jumps.jump > self._jumps.allowed + LASTING_JUMP:
                return (Detection(Fault.S9, axis, jump_um, allowed_um + LASTING_JUMP * width_um),)
            # The sample after the last allowed spike is accepted: the stage has really moved there.
            self.sample = Sample(sample.t_ns, sample.position_um, spikes > SPIKE_SAMPLES)
            return (Detection(Fault.S4, axis, jump_um, allowed_um),)
        drive = (in_force_v - self._low_v) / self._width_v
        stuck = self._stuck.update(reading, drive)
        follow, axis, width_um = self._follow, self._axis, self.width_um
        implausible = follow.update(position, drive, self._recent_v, self._jumps.noise)
        if not (stuck or implausible):
            return _NOTHING
        if stuck:
            # A stuck sensor stops only a mode that uses it.
            fault = Fault.S1 if needed else Fault.S13
            return (Detection(fault, axis, STUCK_SAMPLES, STUCK_SAMPLES),)
        return (Detection(Fault.S9, axis, follow.measured * width_um, follow.limit * width_um),)
