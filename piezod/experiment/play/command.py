"""A periodic command, point by point."""

from typing import NamedTuple

import numpy as np

from piezod.config.play import WaveConfig
from piezod.devices.player import PlayerCapabilities
from piezod.dynamics.harmonics import Lines
from piezod.errors import DataError, DeviceError
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S

FEWEST_POINTS = 16
"""Fewest points of a period: with fewer, a table has no shape."""


class PeriodicCommand(NamedTuple):
    """One period of a command."""

    name: str  #: Name of the waveform, for people.
    values_um: FloatArray  #: (n,) displacement at each point, in µm.
    interval_ns: int  #: Time between two points, in ns.

    @property
    def period_s(self) -> float:
        """Duration of a period, in s."""
        return self.values_um.size * self.interval_ns / NS_PER_S

    @property
    def swing_um(self) -> float:
        """Highest minus lowest value, in µm."""
        return float(np.ptp(self.values_um))

    @property
    def harmonics_hz(self) -> FloatArray:
        """Frequencies of the mean and of the harmonics, in Hz, shape (n // 2 + 1,)."""
        return np.asarray(np.fft.rfftfreq(self.values_um.size, self.interval_ns / NS_PER_S))

    def only(self, kept: Lines) -> "PeriodicCommand":
        """Return the command with some of its harmonics only, and the mean.

        A stage cannot follow the corner of a triangle: no table of finite voltages makes one.

        Args:
            kept: (n // 2 + 1,) mask of the harmonics that are kept.
        """
        spectrum = np.fft.rfft(self.values_um)
        spectrum[1:][~kept[1:]] = 0.0
        return self._replace(values_um=np.fft.irfft(spectrum, self.values_um.size))

    def cycles(self, duration_s: float, at_least: int) -> int:
        """Return the number of periods that last this long, and their least number or more."""
        return max(at_least, int(np.ceil(duration_s / self.period_s - 1e-9)))


def points_of(name: str, period_s: float, interval_ns: int) -> int:
    """Return the number of points of a period.

    Raises:
        DataError: If a period is not a whole number of intervals, or has too few.
    """
    points = period_s * NS_PER_S / interval_ns
    whole = round(points)
    if whole < FEWEST_POINTS or abs(points - whole) > 1e-6 * whole:
        near_hz = NS_PER_S / (interval_ns * max(whole, FEWEST_POINTS))
        raise DataError(
            f"{name} has {points:g} points per period at an interval of {interval_ns / 1000:g} µs, "
            f"allowed: a whole number of at least {FEWEST_POINTS}; {near_hz:.8g} Hz is near"
        )
    return whole


def command_of(wave: WaveConfig, interval_ns: int) -> PeriodicCommand:
    """Return one period of a configured waveform.

    Raises:
        DataError: If a period is not a whole number of intervals.
    """
    points = points_of(wave.name, wave.period_s, interval_ns)
    begin_s, end_s = wave.command_um.begin_and_end_s()
    waveform = wave.command_um.built(end_s)
    t_s = begin_s + np.arange(points) * interval_ns / NS_PER_S
    return PeriodicCommand(wave.name, np.array(waveform.sample(t_s)), interval_ns)


def legal_interval_ns(able: PlayerCapabilities, interval_us: float) -> int:
    """Return the interval of tables, in ns.

    Raises:
        DeviceError: If the device does not have this interval.
    """
    interval_ns = round(1000 * interval_us)
    legal_ns = able.legal_interval_ns(interval_ns)
    if legal_ns != interval_ns:
        raise DeviceError(
            f"the device does not play at an interval of {interval_us:g} µs; the next one that it "
            f"has is {legal_ns / 1000:g} µs"
        )
    return interval_ns
