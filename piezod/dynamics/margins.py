"""Which gains of the trim are safe, given the dynamics of the stage.

At gain K the loop is K L(z), with L from `loop.py`. A loop with hardly any gain is stable, and a
root can leave the unit circle only where K L = -1. So the first gain that reaches -1 is the largest
stable gain. Each margin bounds the gain in the same way: by the first gain that breaks the margin
at some frequency. The proportional gain keeps its ratio to that of the integral. Not for use in the
loop. The paper has no trim.
"""

from functools import lru_cache
from math import floor, inf, log10
from typing import Final, NamedTuple

import numpy as np

from piezod.dynamics.loop import Sampled, TrimLaw, loop_response, sampled_stage
from piezod.dynamics.model import ComplexArray, Resonance, ResponseModel
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

LEAST_DETUNED_GAIN_MARGIN: Final = 1.0
"""With notches the loop must stay stable with all modes 5 % lower, and 5 % higher. A load changes a
mode, and beside it a notch does not act."""

_LATE_STEPS = 8  # number of extra delays in that period
_DETUNED: Final = (0.95, 1.05)
_SPARE: Final = 0.98
_RATIOS: Final = (0.0, *np.geomspace(0.1, 2.0, 9).tolist())
"""Ratios of both gains that are tried for a proposal, over the delay of the loop."""


class TrimMargins(NamedTuple):
    """Margins of a trim."""

    gain_margin: float  #: Factor to the largest stable gain; at 1 or below the loop is unstable.
    #: Smallest phase distance to -180° where the gain of the loop is at least 1; 0 if the loop is
    #: unstable.
    phase_margin_deg: float
    #: Smallest distance of the frequency response from -1; 0 if the loop is unstable.
    modulus_margin: float
    late_gain_margin: float  #: Smallest gain margin with up to one more period of delay.
    #: Smallest gain margin with all modes lower or higher; infinite without notches.
    detuned_gain_margin: float
    largest: TrimLaw  #: Largest gains of this ratio that have all required margins.


class _Stages(NamedTuple):
    """A stage as it is, with more delay, and with other modes."""

    nominal: Sampled
    late: list[Sampled]
    detuned: list[Sampled]


# A loop that takes over a model while it runs has checked the same values at its start: 40 ms less.
@lru_cache(maxsize=32)
def margins_of(law: TrimLaw, period_s: float, stage: ResponseModel) -> TrimMargins:
    """Return the margins of a trim.

    Args:
        law: Its gains and notches.
        period_s: Period of the loop, in s.
        stage: From a voltage at the output to the sample, without the hold.
    """
    return _margins(law, period_s, _stages(period_s, stage, detuned=bool(law.notches)))


@lru_cache(maxsize=8)  # for other gains, as of a search for one
def _stages(period_s: float, stage: ResponseModel, *, detuned: bool) -> _Stages:
    late_s = np.linspace(0.0, period_s, _LATE_STEPS + 1).tolist()
    return _Stages(
        sampled_stage(period_s, stage),
        [sampled_stage(period_s, _later(stage, each_s)) for each_s in late_s],
        [sampled_stage(period_s, _detuned(stage, each)) for each in _DETUNED if detuned],
    )


def _margins(law: TrimLaw, period_s: float, stages: _Stages) -> TrimMargins:
    def largest_stable(stage: Sampled) -> float:
        return _largest_stable(loop_response(law, period_s, stage))

    gain_per_s = law.gain_per_s
    response = loop_response(law, period_s, stages.nominal)
    stable_per_s = _largest_stable(response)
    late_per_s = min(map(largest_stable, stages.late))
    detuned_per_s = min(map(largest_stable, stages.detuned), default=inf)
    stable = gain_per_s < stable_per_s
    largest_per_s = min(
        stable_per_s / LEAST_GAIN_MARGIN,
        _largest_with_phase_margin(response),
        _largest_with_modulus_margin(response),
        late_per_s / LEAST_LATE_GAIN_MARGIN,
        detuned_per_s / LEAST_DETUNED_GAIN_MARGIN,
    )
    return TrimMargins(
        gain_margin=stable_per_s / gain_per_s,
        phase_margin_deg=_phase_margin_deg(gain_per_s * response) if stable else 0.0,
        modulus_margin=float(np.abs(1.0 + gain_per_s * response).min()) if stable else 0.0,
        late_gain_margin=late_per_s / gain_per_s,
        detuned_gain_margin=detuned_per_s / gain_per_s,
        largest=_at_gain(law, largest_per_s),
    )


def refuse_unstable(
    law: TrimLaw, period_s: float, stage: ResponseModel, name: str = "trim"
) -> TrimMargins:
    """Return the margins of a feedback if all are large enough; arguments as for `margins_of`.

    The name of the feedback is for the text.

    Raises:
        ModelError: If a margin is too small; the text names it and the largest gains allowed.
    """
    margins = margins_of(law, period_s, stage)
    too_small = _too_small(margins)
    if too_small:
        allowed = rounded_down(margins.largest)
        raise ModelError(
            f"a {name} gain of {gains_text(law)} is not safe: {'; '.join(too_small)} "
            f"({_stage_text(period_s, stage)}); use at most {gains_text(allowed)}"
        )
    return margins


def within_margins(law: TrimLaw, period_s: float, stage: ResponseModel) -> TrimLaw:
    """Return a trim, with smaller gains if its margins are too small; arguments as `margins_of`."""
    largest = margins_of(law, period_s, stage).largest
    return law if law.gain_per_s <= largest.gain_per_s else rounded_down(largest)


@lru_cache(maxsize=8)  # an axis is built again for each run of an experiment
def propose(period_s: float, stage: ResponseModel, notches: tuple[Resonance, ...] = ()) -> TrimLaw:
    """Return the trim with the largest gain of its integral that has all required margins.

    Slow errors decay fastest with it. Arguments as for `margins_of`.
    """
    stages = _stages(period_s, stage, detuned=bool(notches))
    ratios_s = [ratio * (stage.delay_s + period_s) for ratio in _RATIOS]
    laws = [
        _margins(TrimLaw(1.0, ratio_s, notches), period_s, stages).largest for ratio_s in ratios_s
    ]
    return rounded_down(max(laws, key=lambda law: law.gain_per_s))


def gains_text(law: TrimLaw) -> str:
    """Return the gains of a trim in words."""
    if not law.proportional:
        return f"{law.gain_per_s:g} 1/s"
    return f"{law.gain_per_s:g} 1/s with a proportional gain of {law.proportional:g}"


def _at_gain(law: TrimLaw, gain_per_s: float) -> TrimLaw:
    """Return the same trim with another gain, in 1/s, and the same ratio of its gains."""
    proportional = law.proportional * gain_per_s / law.gain_per_s
    return law._replace(gain_per_s=gain_per_s, proportional=proportional)


def _later(stage: ResponseModel, late_s: float) -> ResponseModel:
    return ResponseModel(stage.delay_s + late_s, stage.resonances)


def _detuned(stage: ResponseModel, factor: float) -> ResponseModel:
    modes = (
        Resonance(factor * mode.frequency_hz, mode.damping, mode.share) for mode in stage.resonances
    )
    return ResponseModel(stage.delay_s, tuple(modes))


def _too_small(margins: TrimMargins) -> list[str]:
    """Return the margins that are too small, as texts."""
    if margins.gain_margin <= 1.0:
        return ["the loop would be unstable"]
    required = (
        ("gain margin", margins.gain_margin, LEAST_GAIN_MARGIN, ""),
        ("phase margin", margins.phase_margin_deg, LEAST_PHASE_MARGIN_DEG, "°"),
        ("modulus margin", margins.modulus_margin, LEAST_MODULUS_MARGIN, ""),
        ("gain margin with more delay", margins.late_gain_margin, LEAST_LATE_GAIN_MARGIN, ""),
        (
            "gain margin with other modes",
            margins.detuned_gain_margin,
            LEAST_DETUNED_GAIN_MARGIN,
            "",
        ),
    )
    return [
        f"{name} {value:.3g}{unit}, needed {least:g}{unit}"
        for name, value, least, unit in required
        if value < least
    ]


def _stage_text(period_s: float, stage: ResponseModel) -> str:
    modes = [f"{mode.frequency_hz:g} Hz with damping {mode.damping:g}" for mode in stage.resonances]
    known = "no first mode known, only the delay counts"
    if modes:
        known = f"first mode {modes[0]}" if len(modes) == 1 else f"modes {', '.join(modes)}"
    return f"period {1e3 * period_s:g} ms, delay {1e3 * stage.delay_s:.3g} ms, {known}"


def rounded_down(law: TrimLaw) -> TrimLaw:
    """Return a trim with its gain rounded down to two significant digits."""
    if not law.proportional:
        return law._replace(gain_per_s=_rounded_down(law.gain_per_s))
    # The rounded ratio of the gains is a little different, so that some margin must be left.
    lower = _at_gain(law, _rounded_down(_SPARE * law.gain_per_s))
    return lower._replace(proportional=float(f"{lower.proportional:.3g}"))


def _rounded_down(gain: float) -> float:
    """Round down to two significant digits."""
    # The factor just below 1 keeps the result below the limit if the division is exact.
    unit = 10.0 ** (floor(log10(gain)) - 1)
    return floor(gain / unit * (1.0 - 1e-9)) * unit


def _largest_stable(response: ComplexArray) -> float:
    """Return the smallest gain that puts the curve through -1, in 1/s."""
    places = np.flatnonzero(response.imag[:-1] * response.imag[1:] <= 0.0)
    ends = np.stack((response[places], response[places + 1]))
    before, after = np.angle(-ends)  # 0 on the negative real axis
    # A sign change of the angle is a crossing; a jump from π to -π, on the positive axis, is none.
    crosses = (before * after <= 0.0) & (np.abs(before - after) < np.pi / 2)
    part = before[crosses] / (before[crosses] - after[crosses])
    # The size at the crossing, interpolated on a logarithmic scale.
    size, following = np.log(np.abs(ends[:, crosses]))
    last = response[-1]  # half the sample rate: real
    at_end = [np.log(np.abs(last))] if last.real < 0.0 else []
    return float(np.exp(-np.max(np.append(size + part * (following - size), at_end))))


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
