"""From a recorded file to a model: read, fit, judge on this file and on another one."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from piezod.errors import DataError
from piezod.experiment.fit import Fit, FitSettings, fit_model
from piezod.experiment.method import Method
from piezod.experiment.record import Record
from piezod.experiment.warnings import fit_warnings
from piezod.hysteresis import AffineRange
from piezod.records.csv_file import read_csv

START_S = 2.0
"""How long a stage that does not start from rest shows it most, in s."""
WORSE_AT_START = 3.0
"""The worst error of the start is suspicious from this many times that of the remainder."""


@dataclass(frozen=True)
class FileFit:
    """A model fitted to a file, and how good it is.

    Attributes:
        data: The file.
        test_data: The other file on which the model was judged, None without one.
        record: What was read from it, without the seconds that were skipped.
        fit: The model, and how it came about.
        train: Errors of the predicted voltage on the record, by name, in % of the model's range.
        test: The same on the other file.
        warnings: What a person should know before using the model, a sentence each.
    """

    data: Path
    test_data: Path | None
    record: Record
    fit: Fit
    train: Mapping[str, float]
    test: Mapping[str, float] | None
    warnings: tuple[str, ...]


def identify_file(
    data: Path,
    *,
    test: Path | None,
    skip_s: float,
    delay_s: float | None,
    method: Method,
    order: int,
) -> FileFit:
    """Fit a model to a recorded file.

    Args:
        data: CSV with the columns t_s, drive_v, position_um.
        test: Another such file, on which the model is judged too.
        skip_s: The first seconds of each file to leave out.
        delay_s: The delay in s; estimated from the data if None.
        method: How to find the weights.
        order: Operators on each side.

    Raises:
        DataError: If a file cannot be used; the text begins with its name.
        OSError: If a file cannot be read.
    """
    record = read_record(data, skip_s)
    test_record = read_record(test, skip_s) if test else None
    try:
        fit = fit_model(
            record,
            FitSettings(method=method, order=order, delay_s=delay_s, from_rest=skip_s == 0.0),
        )
    except DataError as error:
        raise DataError(f"{data}: {error}") from error
    return FileFit(
        data=data,
        test_data=test,
        record=record,
        fit=fit,
        train=fit.errors_pct(record),
        test=fit.errors_pct(test_record) if test_record else None,
        warnings=tuple(_warnings(fit, record, test_record)),
    )


def read_record(path: Path, skip_s: float) -> Record:
    """Read a recorded file without its first seconds.

    Raises:
        DataError: If the file cannot be used; the text begins with its name.
        OSError: If the file cannot be read.
    """
    record = Record(**read_csv(path))
    try:
        return record.after(skip_s)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _warnings(fit: Fit, record: Record, test: Record | None) -> Iterator[str]:
    yield from fit_warnings(fit, record.period_s)
    yield from _start_warnings(fit, record)
    if test is not None:
        yield from _range_warnings(fit.model.position_um, test)


def _start_warnings(fit: Fit, record: Record) -> Iterator[str]:
    aligned = record.aligned(fit.model.delay_s)
    error_v = np.abs(fit.model.predicted_v(aligned) - aligned.drive_v)
    at_start = aligned.t_s - record.t_s[0] < START_S
    if at_start.all() or not at_start.any():
        return
    worst = int(error_v.argmax())
    if at_start[worst] and error_v[worst] > WORSE_AT_START * error_v[~at_start].max():
        yield (
            f"The worst error is at t = {aligned.t_s[worst]:.4g} s. The record seems not to start "
            "from rest; leave out the first loops with --skip-s."
        )


def _range_warnings(position_um: AffineRange, test: Record) -> Iterator[str]:
    x = position_um.to_unit(test.position_um)
    share = float(np.mean((x < 0.0) | (x > 1.0)))
    if share:
        yield (
            f"{100.0 * share:.2g} % of the test's displacements are outside of what the model was "
            f"fitted to, {position_um.low:.6g} to {position_um.high:.6g} µm, and count as its ends."
        )
