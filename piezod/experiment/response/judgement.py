"""The fit of measurements, with what to know about it."""

from collections.abc import Iterator, Sequence
from typing import Final, Literal

import numpy as np

from piezod.dynamics.fitting import ResponseFit, fit_response
from piezod.errors import DataError
from piezod.records.response_record import AboutVoltage, ResponseRecord

DESCRIBED_PCT: Final = 10.0
"""Largest rms distance of model and lines, in % of the gain, without a warning."""
_LARGEST_PHASE_DEG: Final = 20.0
"""Loops with a larger phase are not small."""


def judged(
    axis: str,
    title: str,
    method: Literal["multisine", "recording"],
    rate_hz: float,
    about: Sequence[AboutVoltage],
    remedy: str,
    notes: Sequence[str] = (),
) -> ResponseRecord:
    """Fit a model to measurements, and find what to know about it.

    Raises:
        DataError: If too few lines are clear of the noise.
    """
    try:
        fit = fit_response([each.response for each in about], rate_hz)
    except DataError as error:
        raise DataError(f"axis {axis}: {error}; {remedy}") from error
    warnings = (*notes, *_doubts(fit))
    return ResponseRecord(
        axis=axis,
        title=title,
        method=method,
        rate_hz=rate_hz,
        about=tuple(about),
        fit=fit,
        warnings=warnings,
    )


def described_pct(fit: ResponseFit) -> float:
    """Return the rms distance of model and used lines, in % of the gain at low frequencies."""
    parts = [
        np.abs(fit.fitted(index, lines.frequency_hz) - lines.response) / abs(gain)
        for index, (lines, (gain, _)) in enumerate(zip(fit.used, fit.gains, strict=True))
    ]
    return float(100.0 * np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _doubts(fit: ResponseFit) -> Iterator[str]:
    if fit.is_folded:
        yield (
            "The lines show a mode above half of the rate, folded below it. It is not part of the "
            "model: run the stage at a higher rate_hz, and measure again."
        )
    elif (off_pct := described_pct(fit)) > DESCRIBED_PCT:
        yield (
            f"The model describes the lines only to {off_pct:.2g} % rms of the gain: the stage has "
            "more than three modes, or a filter of the sensor close to a mode. Look at the figure."
        )
    if abs(phase_deg := float(np.degrees(fit.phase_rad))) > _LARGEST_PHASE_DEG:
        yield (
            f"The phase of the small loops is {phase_deg:.3g}° at all frequencies, which is much: "
            "use a smaller amplitude."
        )
