"""Errors of a method on held-out blocks and on a test record, and its costs.

Settings are chosen by the rms error on the same blocks, as `piezod identify` chooses its model. The
errors on the blocks are therefore slightly too good, for every method; those on the test record are
not.
"""

from collections.abc import Iterator
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.method import (
    FloatArray,
    Method,
    Predictor,
    Row,
    Rows,
    Series,
    Setting,
)

BLOCKS = 5
"""Contiguous blocks of a record, each held out once."""
PREDICTIONS = 3
"""Predictions that are timed; the fastest counts."""


def evaluate(method: Method, record: Series, test: Series | None, *, without_offset: bool) -> Row:
    """Choose the settings of a method, and measure its errors and costs.

    Args:
        method: The method.
        record: Record of the fit.
        test: Record of the test.
        without_offset: Whether a constant is removed from the errors of the test.
    """
    started_s = perf_counter()
    errors = {
        index: rms(held_out_residuals(method, record, setting, method.search_stride))
        for index, setting in enumerate(method.grid)
    }
    setting = method.grid[min(errors, key=lambda index: _or_infinite(errors[index]))]
    searched_s = perf_counter()
    held_out = held_out_residuals(method, record, setting)
    fitting_s = perf_counter()
    predict = method.fit(record, record.counted, setting)
    fitted_s = perf_counter()
    residuals = np.full(1, np.nan)
    if test is not None:
        residuals = (predict(test.positions) - test.drives)[test.counted]
        residuals -= np.mean(residuals) if without_offset else 0.0
    return Row(
        method=method.name,
        setting=", ".join(f"{name} {value}" for name, value in setting.items()),
        held_out_max_pct=worst(held_out),
        held_out_rms_pct=rms(held_out),
        test_max_pct=worst(residuals),
        test_rms_pct=rms(residuals),
        fit_s=fitted_s - fitting_s,
        sample_us=1e6 * min(_prediction_s(predict, record.positions)) / record.positions.size,
        search_s=searched_s - started_s,
    )


def held_out_residuals(
    method: Method, record: Series, setting: Setting, stride: int = 1
) -> FloatArray:
    """Return predicted minus actual drive of all samples that count, each held out once.

    A memory runs through the whole record; only the fit leaves the block out.

    Args:
        method: The method.
        record: The record.
        setting: Its settings.
        stride: Only every `stride`-th sample is fitted to.
    """
    residuals = []
    for block in blocks(record.counted):
        used = record.counted.copy()
        used[block] = False
        used[np.arange(used.size) % stride != 0] = False
        predicted = method.fit(record, used, setting)(record.positions)
        residuals.append(predicted[block] - record.drives[block])
    return np.concatenate(residuals)


def blocks(counted: Rows) -> Iterator[NDArray[np.intp]]:
    """Yield the indices of the samples of each block."""
    yield from np.array_split(np.flatnonzero(counted), BLOCKS)


def rms(residuals: FloatArray) -> float:
    """Return the rms of residuals, in %."""
    return 100.0 * float(np.sqrt(np.mean(residuals**2)))


def worst(residuals: FloatArray) -> float:
    """Return the largest absolute residual, in %."""
    return 100.0 * float(np.max(np.abs(residuals)))


def _or_infinite(error: float) -> float:
    return error if np.isfinite(error) else np.inf


def _prediction_s(predict: Predictor, positions: FloatArray) -> Iterator[float]:
    for _ in range(PREDICTIONS):
        started_s = perf_counter()
        predict(positions)
        yield perf_counter() - started_s
