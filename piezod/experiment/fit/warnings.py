"""Warnings for the user of a model, each with a remedy."""

from collections.abc import Iterator

import numpy as np

from piezod.experiment.fit.delay import DelayEstimate
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.record import Record

SATURATED = 0.1
"""A healthy sensor may show one value while the drive moves over at most this share of its
range."""


def fit_warnings(fit: Fit, period_s: float) -> Iterator[str]:
    """Yield the warnings about a model.

    Args:
        fit: The fit.
        period_s: Sample period of the record, in s.
    """
    if fit.delay is not None:
        yield from _delay_warnings(fit.delay, period_s)


def saturation_warnings(record: Record) -> Iterator[str]:
    """Yield the warnings about a sensor that seems to saturate at an end of its range.

    Args:
        record: The record before smoothing.
    """
    x, counted = record.position_um, record.counted()
    range_v = float(np.ptp(record.drive_v[counted]))
    for name, end_um in (("highest", np.max(x[counted])), ("lowest", np.min(x[counted]))):
        there = counted & (x == end_um)
        moved = float(np.ptp(record.drive_v[there])) / range_v
        if moved > SATURATED:
            yield (
                f"The displacement stands at its {name} value, {end_um:.6g} µm, in "
                f"{np.count_nonzero(there)} samples, while the drive moves over "
                f"{100.0 * moved:.2g} % of its range: the sensor seems to saturate. Use a smaller "
                "drive, or move the sensor's range."
            )


def _delay_warnings(delay: DelayEstimate, period_s: float) -> Iterator[str]:
    if delay.one_frequency:
        yield (
            "The drive has one frequency. Such a record determines the delay only to about a "
            f"sample, {1e3 * period_s:.3g} ms: a delay looks like a wider loop, and the model "
            "absorbs part of it. Record several frequencies, or measure the delay in another way "
            "and give it."
        )
    if delay.delay_s == delay.candidates_s[-1]:
        yield (
            f"The delay is the longest that was tried, {1e3 * delay.delay_s:.3g} ms; the true one "
            "may be longer. Measure it in another way, and give it."
        )
