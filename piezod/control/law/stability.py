"""Which gains of the trim are safe, given the delay and the first mode of the stage.

At gain K the loop is K L(z), with L from `piezod.control.law.response`. A loop with hardly any gain
is stable, and a root can leave the unit circle only where K L = -1. So the first gain that reaches
-1 is the largest stable gain. Each margin bounds the gain in the same way: by the first gain that
breaks the margin at some frequency. Not for use in the loop. The paper has no trim.
"""

from functools import lru_cache
from math import floor, log10
from typing import Final, NamedTuple

import numpy as np

from piezod.control.law.response import ComplexArray, loop_response
from piezod.errors import ModelError

LEAST_GAIN_MARGIN: Final = 2.0
"""The stage may react twice as strongly as the inverse model expects. This covers the local slope
of the hysteresis just after a reversal, which an identified inverse gets wrong, and poor models."""
LEAST_PHASE_MARGIN_DEG: Final = 45.0
"""Covers an error of the delay, and keeps the overshoot small."""
LEAST_MODULUS_MARGIN: Final = 0.5
"""Smallest distance of the curve from -1. It limits the amplification of errors and noise to a
factor of two, also at the mode, where gain margin and phase margin can both look good."""
LEAST_LATE_GAIN_MARGIN: Final = 1.0
"""The loop must stay stable with up to one more period of delay. This covers a sample that is one
cycle late, and the phase of the mode, which the identified delay does not include."""

_LATE_STEPS = 8  # number of extra delays in that period


class TrimMargins(NamedTuple):
    """Margins of a gain of the trim.

    Attributes:
        gain_margin: Factor to the largest stable gain; at 1 or below the loop is unstable.
        phase_margin_deg: Smallest phase distance to -180° where the gain of the loop is at least 1;
            0 if the loop is unstable.
        modulus_margin: Smallest distance of the frequency response from -1; 0 if the loop is
            unstable.
        late_gain_margin: Smallest gain margin with up to one more period of delay.
        largest_gain_per_s: Largest gain of the trim that has all required margins, in 1/s.
    """

    gain_margin: float
    phase_margin_deg: float
    modulus_margin: float
    late_gain_margin: float
    largest_gain_per_s: float


class _Loop(NamedTuple):
    """What the margins of all gains of a loop derive from.

    Attributes:
        response: L, shape (n,).
        stable_per_s: Largest stable gain, in 1/s.
        late_per_s: Largest stable gain with up to one more period of delay, in 1/s.
        largest_per_s: Largest gain that has all required margins, in 1/s.
    """

    response: ComplexArray
    stable_per_s: float
    late_per_s: float
    largest_per_s: float


# A loop that takes over a model while it runs has checked the same values at its start: 40 ms less.
@lru_cache(maxsize=32)
def margins_of(
    gain_per_s: float,
    period_s: float,
    delay_s: float,
    mode_hz: float | None,
    mode_damping: float | None,
) -> TrimMargins:
    """Return the margins of a gain.

    Args:
        gain_per_s: Gain of the trim, in 1/s, positive.
        period_s: Period of the loop, in s.
        delay_s: Delay from drive to sensor, in s, not negative.
        mode_hz: Undamped frequency of the first mode, in Hz; None if it is unknown. Then only the
            delay counts.
        mode_damping: Damping ratio of the mode, in (0, 1]; None if it is unknown.
    """
    loop = _loop(period_s, delay_s, mode_hz, mode_damping)
    stable = gain_per_s < loop.stable_per_s
    return TrimMargins(
        gain_margin=loop.stable_per_s / gain_per_s,
        phase_margin_deg=_phase_margin_deg(gain_per_s * loop.response) if stable else 0.0,
        modulus_margin=float(np.abs(1.0 + gain_per_s * loop.response).min()) if stable else 0.0,
        late_gain_margin=loop.late_per_s / gain_per_s,
        largest_gain_per_s=loop.largest_per_s,
    )


@lru_cache(maxsize=8)  # of other gains, as of a search for one
def _loop(
    period_s: float, delay_s: float, mode_hz: float | None, mode_damping: float | None
) -> _Loop:
    response = loop_response(period_s, delay_s, mode_hz, mode_damping)
    stable_per_s = _largest_stable(response)
    later = (
        loop_response(period_s, delay_s + late_s, mode_hz, mode_damping)
        for late_s in np.linspace(0.0, period_s, _LATE_STEPS + 1)[1:].tolist()
    )
    late_per_s = min(stable_per_s, *map(_largest_stable, later))
    largest_per_s = min(
        stable_per_s / LEAST_GAIN_MARGIN,
        _largest_with_phase_margin(response),
        _largest_with_modulus_margin(response),
        late_per_s / LEAST_LATE_GAIN_MARGIN,
    )
    return _Loop(response, stable_per_s, late_per_s, largest_per_s)


def refuse_unstable(
    gain_per_s: float,
    period_s: float,
    delay_s: float,
    mode_hz: float | None,
    mode_damping: float | None,
) -> TrimMargins:
    """Return the margins of a gain if all are large enough; arguments as for `margins_of`.

    Raises:
        ModelError: If a margin is too small; the text names it and the largest gain allowed.
    """
    margins = margins_of(gain_per_s, period_s, delay_s, mode_hz, mode_damping)
    too_small = _too_small(margins)
    if too_small:
        raise ModelError(
            f"a trim gain of {gain_per_s:g} 1/s is not safe: {'; '.join(too_small)} "
            f"({_stage_text(period_s, delay_s, mode_hz, mode_damping)}); "
            f"use at most {_rounded_down(margins.largest_gain_per_s):g} 1/s"
        )
    return margins


def _too_small(margins: TrimMargins) -> list[str]:
    """Return the margins that are too small, as texts."""
    if margins.gain_margin <= 1.0:
        return ["the loop would be unstable"]
    required = (
        ("gain margin", margins.gain_margin, LEAST_GAIN_MARGIN, ""),
        ("phase margin", margins.phase_margin_deg, LEAST_PHASE_MARGIN_DEG, "°"),
        ("modulus margin", margins.modulus_margin, LEAST_MODULUS_MARGIN, ""),
        ("gain margin with more delay", margins.late_gain_margin, LEAST_LATE_GAIN_MARGIN, ""),
    )
    return [
        f"{name} {value:.3g}{unit}, needed {least:g}{unit}"
        for name, value, least, unit in required
        if value < least
    ]


def _stage_text(
    period_s: float, delay_s: float, mode_hz: float | None, mode_damping: float | None
) -> str:
    mode = "no first mode known, only the delay counts"
    if mode_hz is not None:
        mode = f"first mode {mode_hz:g} Hz with damping {mode_damping:g}"
    return f"period {1e3 * period_s:g} ms, delay {1e3 * delay_s:.3g} ms, {mode}"


def _rounded_down(gain: float) -> float:
    """Round down to two significant digits."""
    # The factor just below 1 keeps the result below the limit if the division is exact.
    unit = 10.0 ** (floor(log10(gain)) - 1)
    return floor(gain / unit * (1.0 - 1e-9)) * unit


def _largest_stable(response: ComplexArray) -> float:
    """Return the smallest gain that puts the curve through -1, in 1/s."""
    angle = np.angle(-response)  # 0 on the negative real axis
    # A sign change of the angle is a crossing; a jump from π to -π, on the positive axis, is none.
    before, after = angle[:-1], angle[1:]
    crosses = (before * after <= 0.0) & (np.abs(before - after) < np.pi / 2)
    part = before[crosses] / (before[crosses] - after[crosses])
    # The size at the crossing, interpolated on a logarithmic scale.
    size = np.log(np.abs(response))
    crossings = size[:-1][crosses] + part * (size[1:] - size[:-1])[crosses]
    at_end = [size[-1]] if response[-1].real < 0.0 else []  # half the sample rate: real
    return float(np.exp(-np.max(np.append(crossings, at_end))))


def _largest_with_phase_margin(response: ComplexArray) -> float:
    """Return the smallest gain that puts a point of the sector around -180° on the unit circle."""
    in_sector = np.abs(np.angle(-response, deg=True)) < LEAST_PHASE_MARGIN_DEG
    return float(1.0 / np.abs(response[in_sector]).max())


def _largest_with_modulus_margin(response: ComplexArray) -> float:
    """Return the smallest gain that puts a point on the circle around -1.

    |1 + K L|² = margin² is a quadratic equation in K. Its smaller root is where a point enters.
    """
    square, real = np.abs(response) ** 2, response.real
    outside = 1.0 - LEAST_MODULUS_MARGIN**2
    discriminant = real**2 - outside * square
    enters = (real < 0.0) & (discriminant >= 0.0)
    root = (-real[enters] - np.sqrt(discriminant[enters])) / square[enters]
    return float(root.min())


def _phase_margin_deg(loop: ComplexArray) -> float:
    """Return the smallest angle to -180° wherever the gain of the loop is at least 1."""
    return float(np.abs(np.angle(-loop, deg=True))[np.abs(loop) >= 1.0].min())
