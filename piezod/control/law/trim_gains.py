"""Gains of the feedback of an axis: what they are, whether they are safe, which are proposed."""

from math import pi
from typing import Final

from piezod.config.axes import AxisConfig
from piezod.config.modes import Mode
from piezod.config.trim import ClosedConfig, TrimConfig
from piezod.control.law.dynamics import known_dynamics
from piezod.control.law.response_files import response_model
from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.loop import TrimLaw
from piezod.dynamics.margins import (
    LEAST_GAIN_MARGIN,
    gains_text,
    margins_of,
    propose,
    refuse_unstable,
    within_margins,
)
from piezod.dynamics.notch import notched
from piezod.errors import ModelError

USUAL_GAIN_PER_S: Final = 50.0
"""Gain of a trim whose configuration gives none: errors decay within 20 ms."""
USUAL_CLOSED_GAIN_PER_S: Final = 100.0
"""Gain of mode `closed` whose configuration gives none. On simulated stages of other classes the
worst error is least near 100 1/s: more passes more noise of the sensor on, less leaves more
error of the model. A proportional gain passes on most."""
_GAIN_AT_MODE: Final = 1.0 / LEAST_GAIN_MARGIN
"""Largest gain of the loop at a sharp mode that nobody knows."""
_NAMES: Final = {Mode.TRIMMED: "trim", Mode.CLOSED: "closed"}


def feedback_law(mode: Mode, config: AxisConfig, period_s: float, delay_s: float) -> TrimLaw:
    """Return the gains and notches of an axis.

    A gain that is not given is the usual one, or the largest with enough margin. A given one, also
    a given proportional gain, is never changed.

    Args:
        mode: Mode with a feedback: `trimmed` or `closed`.
        config: Configuration of the axis, with its response or its first mode.
        period_s: Period of the loop, in s.
        delay_s: Delay from drive to sensor of an identified model, in s; a response has its own.
    """
    settings: TrimConfig | ClosedConfig = config.trim
    usual_per_s = USUAL_GAIN_PER_S
    # The notch of a trim has the measured modes only: a first mode of a data sheet may be off.
    has_notch = config.trim.notch == "auto" and config.response is not None
    if mode is Mode.CLOSED:
        settings, usual_per_s, has_notch = config.closed, USUAL_CLOSED_GAIN_PER_S, True
    notches = notched(_modes(config, period_s), period_s) if has_notch else ()
    law = TrimLaw(settings.gain_per_s or usual_per_s, settings.proportional, notches)
    if settings.gain_per_s is not None or settings.proportional:
        return law
    return within_margins(law, period_s, _loop_stage(config, period_s, delay_s))


def check_feedback(mode: Mode, config: AxisConfig, period_s: float, delay_s: float) -> None:
    """Refuse gains that leave too little margin; arguments as for `feedback_law`.

    Raises:
        ModelError: If a margin is too small, or if the dynamics are unknown in mode `closed`.
    """
    if mode is Mode.CLOSED and config.response is None and config.first_mode is None:
        raise ModelError(
            "mode closed needs the first mode of the stage, and neither `response` nor "
            "`first_mode` nor the model tells it: measure it with `piezod response`, and name the "
            "file as `response` of the axis, or use mode adaptive or trimmed"
        )
    law, stage = (
        feedback_law(mode, config, period_s, delay_s),
        _loop_stage(config, period_s, delay_s),
    )
    refuse_unstable(law, period_s, stage, _NAMES[mode])


def slowest_untold_mode_hz(
    mode: Mode, config: AxisConfig, period_s: float, delay_s: float, damping: float
) -> float:
    """Return the frequency below which an unknown mode of this damping might oscillate, in Hz.

    Other arguments as for `feedback_law`. A sharp mode amplifies K/ω by 1/(2ζ).
    """
    law = feedback_law(mode, config, period_s, delay_s)
    return law.gain_per_s / (2.0 * damping * _GAIN_AT_MODE * 2.0 * pi)


def margins_text(mode: Mode, config: AxisConfig, period_s: float, delay_s: float) -> str:
    """Return the margins of the feedback of an axis, and the gains that are proposed, for people.

    Arguments as for `feedback_law`.
    """
    law, stage = (
        feedback_law(mode, config, period_s, delay_s),
        _loop_stage(config, period_s, delay_s),
    )
    margins = margins_of(law, period_s, stage)
    notches = ", ".join(f"{each.frequency_hz:g} Hz" for each in law.notches)
    return (
        f"{_NAMES[mode]} {gains_text(law)}{f', notch at {notches}' if notches else ''}: "
        f"gain margin {margins.gain_margin:.3g}, phase margin {margins.phase_margin_deg:.3g}°, "
        f"modulus margin {margins.modulus_margin:.3g}; "
        f"fastest with enough margin: {gains_text(propose(period_s, stage, law.notches))}"
    )


def _modes(config: AxisConfig, period_s: float) -> tuple[Resonance, ...]:
    """Return the known modes: those of the response, or else the first mode."""
    dynamics = known_dynamics(config, period_s)
    if dynamics is not None:
        return dynamics.modes
    mode = config.first_mode
    return (Resonance(mode.frequency_hz, mode.damping),) if mode else ()


def _loop_stage(config: AxisConfig, period_s: float, delay_s: float) -> ResponseModel:
    """Return the stage as the loop of the feedback sees it, without the hold."""
    if config.response is not None:
        return response_model(config.response)
    # Counted from the middle of the cycle in which a voltage holds.
    return ResponseModel(max(delay_s, 0.0) + 0.5 * period_s, _modes(config, period_s))
