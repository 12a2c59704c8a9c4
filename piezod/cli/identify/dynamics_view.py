"""The text of `piezod identify` about the delay and the first mode."""

import numpy as np
from rich.console import Console

from piezod.experiment.fit.delay import DelayEstimate
from piezod.experiment.fit.file import FileFit
from piezod.experiment.fit.warnings import mode_text
from piezod.hysteresis.memory import FloatArray

_BARS = "▁▂▃▄▅▆▇█"
_CURVE_COLUMNS = 61
"""Columns of the curve; with its ends they fit on a line of 80."""


def print_delay(console: Console, delay_s: float, delay: DelayEstimate | None) -> None:
    """Print the delay, and the errors of others.

    Args:
        console: The console.
        delay_s: The delay, in s.
        delay: Its estimate; None if it was given.
    """
    if delay is None:
        console.print(f"Delay {in_ms(delay_s)}, as given.")
        return
    first, last = in_ms(delay.candidates_s[0]), in_ms(delay.candidates_s[-1])
    low, high = delay.criterion_pct.min(), delay.criterion_pct.max()
    curve_pct = narrowed(delay.criterion_pct)
    best = int(curve_pct.argmin())
    console.print(
        f"Delay {in_ms(delay_s)}, from the smallest rms error of the predicted "
        f"{'position' if delay.of_position else 'voltage'}; a shift of up to "
        f"{in_ms(delay.uncertainty_s)} could hide in that error:\n"
    )
    margin = " " * (len(first) + 3)
    console.print(f"  {first} {_curve(curve_pct)} {last}")
    console.print(f"{margin}{' ' * best}▲ {low:.3g} %, the worst is {high:.3g} %\n")
    if delay_s < 0.0:
        console.print(
            "It is negative: the position leads the recorded voltage. A voltage that the hardware "
            "holds between two samples makes it smaller by half a sample period; or each sample "
            "was taken after the time that the record gives it.\n"
        )


def narrowed(values: FloatArray) -> FloatArray:
    """Return the smallest values of neighbours, so that they fit on a line of 80 columns."""
    parts = np.array_split(values, min(values.size, _CURVE_COLUMNS))
    return np.array([part.min() for part in parts])


def _curve(values: FloatArray) -> str:
    """Return values as a row of bars; the height is the distance from the smallest value."""
    above = (values - values.min()) / max(float(values.max() - values.min()), 1e-300)
    return "".join(_BARS[round(share * (len(_BARS) - 1))] for share in above)


def mode_line(fitted: FileFit) -> str:
    """Return which first mode is part of the model, and why; empty without one."""
    fit, half = fitted.chosen.fit, fitted.uncertainty.mode
    mode, shown = fit.model.mode, fit.shows_mode
    if mode is None or half is None or shown is None:
        return ""
    text = (
        f"First mode at {mode_text(mode, half)} (95 %). It is part of the model, because the fit "
        f"predicts held-out positions to {shown.with_pct:.3g} % rms with it, and to "
        f"{shown.without_pct:.3g} % without it. "
    )
    if configured := fitted.configured_mode:
        return text + (
            f"The configuration has {configured.frequency_hz:.5g} Hz and {configured.damping:.3g}."
        )
    return text + (
        f"For the axis: `first_mode: {{frequency_hz: {mode.frequency_hz:.5g}, "
        f"damping: {mode.damping:.3g}}}`."
    )


def in_ms(time_s: float) -> str:
    """Return a time in s as a text in ms."""
    return f"{1e3 * time_s:.3g} ms"
