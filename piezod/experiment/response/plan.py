"""The excitation: at rest about a voltage, then small steps, then multisines."""

from collections.abc import Sequence as Many
from dataclasses import dataclass
from math import ceil, floor
from typing import Final, NamedTuple

import numpy as np

from piezod.config.axes import LimitsConfig
from piezod.config.waveforms.combined import Sequence, SequencePart, Sum
from piezod.config.waveforms.paths import Points, Staircase
from piezod.config.waveforms.shapes import Component, Multisine
from piezod.dynamics.multisine import IntArray, low_peak_multisine, odd_harmonics
from piezod.dynamics.multisine import Multisine as Lines
from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray

MOST_LINES: Final = 120
PART_LINES: Final = 60
"""Lines of one multisine of the configuration; more are divided among two."""
HIGHEST: Final = 0.45
"""Highest line by default, as a share of the rate."""
FLAT: Final = 1 / 20
"""Lines up to this share of the rate have the same amplitude, and faster ones the same slew rate:
otherwise these would use up that of the axis."""
LIMIT: Final = 0.5
"""Lines must be below this share of the rate."""
LOWEST_HZ: Final = 1.0
OCTAVES: Final = 60.0
"""The lowest line by default is at least this factor below the highest."""
RATE_SHARE: Final = 1 / 2000
AMPLITUDE_SHARE: Final = 0.02
"""Amplitude by default, as a share of the voltages of the axis."""
AVERAGED_S, FEWEST_PERIODS = 8.0, 8
"""Averaged time and number of periods by default, at least."""
LEFT_OUT_S: Final = 0.5
"""The first periods are left out: at least this time, and at least one period."""
SETTLE_S, NOISE_S = 1.0, 2.0
"""Rest about a voltage: for the creep, then for the noise."""
_USED_PART: Final = 0.999  # rounding must not carry the drive beyond its range
STEPS: Final = 8
STEP_S, STEP_CYCLES = 0.1, 40
"""Duration of a step: at least this time and number of cycles."""
SLEW_PART: Final = 0.9
"""Used part of the slew rate: a late cycle makes a larger step."""


class Wanted(NamedTuple):
    """What the user asked for; None for the default."""

    #: Voltages about which the axis is driven, in V; empty for the middle.
    offsets_v: Many[float] = ()
    amplitude_v: float | None = None  #: Largest deviation from them, in V.
    low_hz: float | None = None  #: Lowest line, in Hz.
    high_hz: float | None = None  #: Highest line, in Hz.
    periods: int | None = None  #: Number of averaged periods.


@dataclass(frozen=True, kw_only=True)
class ResponsePlan:
    """The drive about one voltage."""

    offset_v: float  #: The voltage, in V.
    amplitude_v: float  #: Largest deviation from it, in V.
    largest_v: float  #: Largest allowed amplitude, in V.
    rate_hz: float  #: Cycles per second.
    period: int  #: Samples of a period.
    periods: int  #: Number of averaged periods.
    rest: tuple[int, int]  #: First sample of the rest, and the one after its last.
    first: int  #: First sample of the averaged periods.
    harmonics: IntArray  #: (n,) lines, as multiples of the lowest frequency.
    drive_v: Sequence  #: The waveform, from the rest voltage on.
    samples: int  #: Its duration, in samples.

    @property
    def duration_s(self) -> float:
        """Duration of the drive, in s."""
        return self.samples / self.rate_hz

    def sampled_v(self) -> FloatArray:
        """Return the voltage of each cycle, in V, shape (samples,)."""
        t_s = np.arange(self.samples) / self.rate_hz
        return np.array(self.drive_v.built(self.duration_s).sample(t_s))


def plan_response(
    wanted: Wanted, limits: LimitsConfig, ramp_v_per_s: float, rate_hz: float
) -> tuple[ResponsePlan, ...]:
    """Return the drive about each voltage.

    Args:
        wanted: What the user asked for.
        limits: Limits of the axis.
        ramp_v_per_s: Rate of the way from the rest voltage, in V/s.
        rate_hz: Cycles per second.

    Raises:
        DataError: If a value is outside what the limits and the rate allow.
    """
    period, lines = _multisine(wanted, rate_hz)
    periods = wanted.periods or max(FEWEST_PERIODS, ceil(AVERAGED_S * rate_hz / period))
    middle_v = 0.5 * (limits.drive_min_v + limits.drive_max_v)
    usual_v = AMPLITUDE_SHARE * (limits.drive_max_v - limits.drive_min_v)
    plans = []
    for offset_v in wanted.offsets_v or (middle_v,):
        largest_v = _largest_v(offset_v, limits, lines, period, rate_hz)
        amplitude_v = wanted.amplitude_v or min(usual_v, largest_v)
        if amplitude_v > largest_v:
            raise DataError(
                f"an amplitude of {amplitude_v:g} V about {offset_v:g} V exceeds range or slew "
                f"rate of the axis, allowed: at most {floor(1e3 * largest_v) / 1e3:g} V; a lower "
                "--high-hz allows more if the slew rate is the limit"
            )
        drive = _Drive(limits.rest_v, rate_hz)
        drive.ramp(offset_v, ramp_v_per_s)
        rest = drive.hold(SETTLE_S), drive.hold(NOISE_S)
        drive.steps(offset_v, min(amplitude_v, SLEW_PART * limits.slew_v_per_s / rate_hz))
        first = drive.multisine(lines, offset_v, amplitude_v, period, periods)
        plans.append(
            ResponsePlan(
                offset_v=offset_v,
                amplitude_v=amplitude_v,
                largest_v=largest_v,
                rate_hz=rate_hz,
                period=period,
                periods=periods,
                rest=rest,
                first=first,
                harmonics=lines.harmonics,
                drive_v=Sequence(kind="sequence", parts=tuple(drive.parts)),
                samples=drive.samples,
            )
        )
    return tuple(plans)


def _multisine(wanted: Wanted, rate_hz: float) -> tuple[int, Lines]:
    """Return the samples of a period, and the lines."""
    limit_hz = LIMIT * rate_hz
    high_hz = wanted.high_hz or min(HIGHEST * rate_hz, 10_000.0)
    if not high_hz < limit_hz:
        raise DataError(
            f"{high_hz:g} Hz cannot be measured at {rate_hz:g} Hz, allowed: below {limit_hz:g} Hz, "
            "half of the rate; run the stage at a higher rate_hz"
        )
    low_hz = wanted.low_hz or min(max(LOWEST_HZ, RATE_SHARE * rate_hz), high_hz / OCTAVES)
    period = round(rate_hz / low_hz)
    harmonics = odd_harmonics(1.0, high_hz * period / rate_hz, MOST_LINES)
    if harmonics.size < 2:
        raise DataError(
            f"there is one line only between {low_hz:g} and {high_hz:g} Hz; give a lower --low-hz "
            "or a higher --high-hz"
        )
    corner = FLAT * period
    return period, low_peak_multisine(harmonics, np.minimum(1.0, corner / harmonics))


def _largest_v(
    offset_v: float, limits: LimitsConfig, lines: Lines, period: int, rate_hz: float
) -> float:
    """Return the largest amplitude within range and slew rate, in V."""
    room_v = _USED_PART * min(offset_v - limits.drive_min_v, limits.drive_max_v - offset_v)
    if room_v <= 0.0:
        raise DataError(
            f"an offset of {offset_v:g} V leaves no room for an amplitude, allowed: above "
            f"{limits.drive_min_v:g} and below {limits.drive_max_v:g} V"
        )
    steepest_v = SLEW_PART * limits.slew_v_per_s / rate_hz
    steepest = float(np.max(np.abs(np.diff(lines.sample(np.arange(period + 1) / period)))))
    # The stage bounds a multisine by the sum of its amplitudes.
    unit_v = min(room_v / float(lines.amplitudes.sum()), steepest_v / steepest)
    return min(room_v, unit_v * lines.peak)


class _Drive:
    """Puts the parts of a drive one after the other."""

    def __init__(self, rest_v: float, rate_hz: float) -> None:
        self._level_v, self._rate_hz = rest_v, rate_hz
        self.parts: list[SequencePart] = []
        self.samples = 0

    def ramp(self, to_v: float, rate_v_per_s: float) -> None:
        duration_s = self._samples(abs(to_v - self._level_v) / rate_v_per_s) / self._rate_hz
        points = ((0.0, self._level_v), (duration_s, to_v))
        self._level_v = to_v
        self._add(Points(kind="points", points=points), duration_s)

    def hold(self, duration_s: float) -> int:
        """Hold the voltage; return the number of the last sample."""
        held = Points(kind="points", points=((0.0, self._level_v),))
        self._add(held, self._samples(duration_s) / self._rate_hz)
        return self.samples

    def steps(self, offset_v: float, step_v: float) -> None:
        dwell_s = self._samples(max(STEP_S, STEP_CYCLES / self._rate_hz)) / self._rate_hz
        levels = tuple(offset_v + (step_v if i % 2 == 0 else 0.0) for i in range(STEPS))
        staircase = Staircase(kind="staircase", levels=levels, dwell_s=dwell_s)
        self._add(staircase, STEPS * dwell_s)

    def multisine(
        self, lines: Lines, offset_v: float, amplitude_v: float, period: int, periods: int
    ) -> int:
        """Drive a multisine; return the number of its first averaged sample."""
        amplitudes_v = lines.amplitudes * (amplitude_v / lines.peak)
        base_hz = self._rate_hz / period
        left_out = ceil(LEFT_OUT_S * self._rate_hz / period) * period
        components = tuple(
            Component(
                amplitude=float(each_v),
                frequency_hz=float(harmonic * base_hz),
                phase_deg=float(np.degrees(phase)) + 180.0,  # from the lowest point
            )
            for each_v, harmonic, phase in zip(
                amplitudes_v, lines.harmonics, lines.phases_rad, strict=True
            )
        )
        # Each part swings about zero, and the first one about the offset.
        parts = tuple(
            Multisine(
                kind="multisine",
                low=(0.0 if begin else offset_v) - sum(each.amplitude for each in some),
                components=some,
            )
            for begin in range(0, len(components), PART_LINES)
            for some in (components[begin : begin + PART_LINES],)
        )
        waveform = parts[0] if len(parts) == 1 else Sum(kind="sum", parts=parts)
        first = self.samples + left_out
        # One period more: the record may be shifted by some cycles.
        self._add(waveform, (left_out + (periods + 1) * period) / self._rate_hz)
        return first

    def _samples(self, duration_s: float) -> int:
        return max(1, ceil(duration_s * self._rate_hz - 1e-9))

    def _add(self, waveform: Points | Staircase | Multisine | Sum, duration_s: float) -> None:
        self.parts.append(SequencePart(duration_s=duration_s, waveform=waveform))
        self.samples += round(duration_s * self._rate_hz)
