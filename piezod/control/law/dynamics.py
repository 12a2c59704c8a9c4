"""The linear dynamics behind the hysteresis of an axis, as the control law uses them."""

from collections.abc import Iterable, Sequence
from math import copysign, pi
from typing import NamedTuple

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.response_file import RINGS_BELOW
from piezod.control.law.compensator import DriveHistory
from piezod.control.law.response_files import response_model
from piezod.dynamics import Resonance
from piezod.dynamics.modal import modal_step
from piezod.units import NS_PER_S

SPARE_ENTRIES = 4
"""Entries that a history keeps beyond the delay: for both ends, and for late samples. No sample is
paired with the oldest entry."""


class StageDynamics(NamedTuple):
    """Dynamics of a stage with a known response.

    A resonance that does not ring is a filter of the sensor or of the amplifier, in series with the
    modes. It counts as the delay that it is for slow motion.
    """

    #: The mechanical modes, with a static gain of one; none if none is known.
    modes: tuple[Resonance, ...]
    #: Delay of a sample behind the voltage, without that of the modes, in s. Between two cycles the
    #: voltage is a straight line, as in `StageModel`.
    delay_s: float

    @property
    def slow_delay_s(self) -> float:
        """Delay for slow motion, with that of the modes, in s: that of an identified model."""
        return self.delay_s + _slow_delay_s(self.modes)


def known_dynamics(config: AxisConfig, period_s: float) -> StageDynamics | None:
    """Return the dynamics of an axis; None if its response is not known.

    Args:
        config: Configuration of the axis.
        period_s: Period of the loop, in s.
    """
    if config.response is None:
        return None
    resonances = response_model(config.response).resonances
    modes = _behind_filters(resonances)
    filters_s = _slow_delay_s(resonances) - _slow_delay_s(modes)
    # A straight line up to the next voltage is half a period later than the held voltage.
    return StageDynamics(modes, config.response.delay_s + filters_s - 0.5 * period_s)


def lowest_mode_hz(resonances: Iterable[Resonance]) -> float | None:
    """Return the frequency of the lowest mode that rings, in Hz; None if there is none."""
    ringing = [each.frequency_hz for each in resonances if each.damping < RINGS_BELOW]
    return min(ringing, default=None)


def _behind_filters(resonances: Sequence[Resonance]) -> tuple[Resonance, ...]:
    """Return the modes without the filters; their shares add up to one.

    Side by side with its filter, a mode has the share that the filter passes at its frequency; the
    sign is part of the phase.
    """
    filters = [each for each in resonances if each.damping >= RINGS_BELOW]
    ringing = [each for each in resonances if each.damping < RINGS_BELOW]
    shares = []
    for mode in ringing:
        frequency_hz = np.array([mode.frequency_hz])
        passed = complex(np.prod([each.at(frequency_hz) for each in filters]))
        shares.append(mode.share / copysign(abs(passed), passed.real))
    total = sum(shares)
    return tuple(
        Resonance(mode.frequency_hz, mode.damping, share / total)
        for mode, share in zip(ringing, shares, strict=True)
        if total
    )


def _slow_delay_s(resonances: Sequence[Resonance]) -> float:
    return sum(each.share * each.damping / (pi * each.frequency_hz) for each in resonances)


class ModalMotion:
    """The part of a displacement that the modes add to the static one. Real-time safe.

    The static displacement is a straight line between two cycles, so that each mode advances
    exactly.

    Args:
        modes: The modes, with a static gain of one.
        period_ns: Period of the loop, in ns.
        delay_ns: Delay of a sample behind the voltage, without that of the modes, in ns.
        static: Displacement at the start, at rest.
    """

    def __init__(
        self, modes: Sequence[Resonance], period_ns: int, delay_ns: int, static: float
    ) -> None:
        self._steps = [modal_step(mode, period_ns / NS_PER_S) for mode in modes]
        self._states = [(0.0, 0.0)] * len(self._steps)
        self._delay_ns, self._static = delay_ns, static
        self._past = DriveHistory(0.0, max(delay_ns, 0) // period_ns + SPARE_ENTRIES)

    def advance(self, t_ns: int, static: float) -> None:
        """Advance by one cycle. Call once per cycle.

        Args:
            t_ns: Instant of the cycle, in ns.
            static: Static displacement that belongs to the voltage in force.
        """
        change, self._static = static - self._static, static
        sum_added = 0.0
        for i, step in enumerate(self._steps):
            added, speed = self._states[i]
            aa, av, au, va, vv, vu, share = step
            added, speed = (
                aa * added + av * speed + au * change,
                va * added + vv * speed + vu * change,
            )
            self._states[i] = added, speed
            sum_added += share * added
        self._past.append(t_ns, sum_added)

    def shown(self, sample_ns: int) -> float:
        """Return the part that a sample shows, by its time stamp in ns."""
        return self._past.at(sample_ns - self._delay_ns)
