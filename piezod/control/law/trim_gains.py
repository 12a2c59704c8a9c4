"""Gains of the trim of an axis: what they are, whether they are safe, and which are proposed."""

from typing import Final

from piezod.config.axes import AxisConfig
from piezod.control.law.dynamics import known_dynamics
from piezod.control.law.response_files import response_model
from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.loop import TrimLaw
from piezod.dynamics.margins import (
    gains_text,
    margins_of,
    propose,
    refuse_unstable,
    within_margins,
)
from piezod.dynamics.notch import notched

USUAL_GAIN_PER_S: Final = 50.0
"""Gain of a trim whose configuration gives none: errors decay within 20 ms."""


def trim_law(config: AxisConfig, period_s: float, delay_s: float) -> TrimLaw:
    """Return the gains and notches of an axis.

    A gain that is not given is the usual one, or the largest with enough margin. A given one, also
    a given proportional gain, is never changed.

    Args:
        config: Configuration of the axis, with its trim, and with its response or its first mode.
        period_s: Period of the loop, in s.
        delay_s: Delay from drive to sensor of an identified model, in s; a response has its own.
    """
    trim, dynamics = config.trim, known_dynamics(config, period_s)
    notches: tuple[Resonance, ...] = ()
    if trim.notch == "auto" and dynamics is not None:
        notches = notched(dynamics.modes, period_s)
    law = TrimLaw(trim.gain_per_s or USUAL_GAIN_PER_S, trim.proportional, notches)
    if trim.gain_per_s is not None or trim.proportional:
        return law
    return within_margins(law, period_s, _loop_stage(config, period_s, delay_s))


def check_trim(config: AxisConfig, period_s: float, delay_s: float) -> None:
    """Refuse gains of the trim that leave too little margin; arguments as for `trim_law`.

    Raises:
        ModelError: If a margin is too small.
    """
    law, stage = trim_law(config, period_s, delay_s), _loop_stage(config, period_s, delay_s)
    refuse_unstable(law, period_s, stage)


def margins_text(config: AxisConfig, period_s: float, delay_s: float) -> str:
    """Return the margins of the trim of an axis, and the gains that are proposed, for people.

    Arguments as for `trim_law`.
    """
    law, stage = trim_law(config, period_s, delay_s), _loop_stage(config, period_s, delay_s)
    margins = margins_of(law, period_s, stage)
    notches = ", ".join(f"{mode.frequency_hz:g} Hz" for mode in law.notches)
    return (
        f"trim {gains_text(law)}{f', notch at {notches}' if notches else ''}: "
        f"gain margin {margins.gain_margin:.3g}, phase margin {margins.phase_margin_deg:.3g}°, "
        f"modulus margin {margins.modulus_margin:.3g}; "
        f"fastest with enough margin: {gains_text(propose(period_s, stage, law.notches))}"
    )


def _loop_stage(config: AxisConfig, period_s: float, delay_s: float) -> ResponseModel:
    """Return the stage as the loop of the trim sees it, without the hold."""
    if config.response is not None:
        return response_model(config.response)
    mode = config.first_mode
    modes = (Resonance(mode.frequency_hz, mode.damping),) if mode else ()
    # Counted from the middle of the cycle in which a voltage holds.
    return ResponseModel(max(delay_s, 0.0) + 0.5 * period_s, modes)
