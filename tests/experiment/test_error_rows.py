"""Tests of the errors of a run: measured, true, and the noise of the sensor."""

from typing import get_args

import numpy as np
import pytest

from piezod.config.experiment_fields import Metric
from piezod.experiment.error_rows import MEASURED, NEED_TRUTH, NOISE, TRUE, errors_pct

T_S = np.arange(4000) / 1000.0
COMMAND = 5.0 - 5.0 * np.cos(2.0 * np.pi * T_S)
NOWHERE = np.full(T_S.size, np.nan)
ALL = (*MEASURED, *TRUE, *NOISE)


def test_every_metric_of_a_file_has_a_function() -> None:
    """There is no other function."""
    assert set(get_args(Metric)) == set(ALL)


def test_true_errors_are_those_of_the_truth() -> None:
    """They equal the measured errors of a perfect sensor, under their own names."""
    truth = COMMAND + 0.1 * np.sin(2.0 * np.pi * T_S)
    position = truth + 0.3 * np.sin(40.0 * T_S)

    errors = errors_pct(ALL, COMMAND, position, truth)
    perfect = errors_pct(ALL, COMMAND, truth, truth)

    assert errors["true_tracking_max_pct"] == perfect["tracking_max_pct"] == pytest.approx(1.0, 0.1)
    assert errors["true_nonlinearity_pct"] == perfect["nonlinearity_pct"]
    assert errors["nonlinearity_pct"] > 2.0 * errors["true_nonlinearity_pct"]
    assert errors["noise_rms_pct"] == pytest.approx(2.1, abs=0.1)
    assert perfect["noise_rms_pct"] == pytest.approx(0.0, abs=1e-9)


def test_errors_have_the_requested_order() -> None:
    """There are no other errors."""
    names = ("noise_rms_pct", "true_nonlinearity_pct", "tracking_max_pct")

    assert tuple(errors_pct(names, COMMAND, COMMAND, COMMAND)) == names


def test_unknown_truth_has_no_true_errors() -> None:
    """The measured errors are there anyway."""
    errors = errors_pct(ALL, COMMAND, COMMAND + 0.1, NOWHERE)

    assert {name for name, value in errors.items() if np.isnan(value)} == set(NEED_TRUTH)
    assert errors["tracking_max_pct"] == pytest.approx(1.0)


def test_errors_ignore_invalid_samples() -> None:
    """An invalid sample counts in neither measured nor true errors."""
    position, truth = COMMAND + 0.1, COMMAND + 0.05
    position[1000:1010] = np.nan
    truth[1000:1010] += 3.0

    errors = errors_pct(ALL, COMMAND, position, truth)

    assert errors["tracking_max_pct"] == pytest.approx(1.0)
    assert errors["true_tracking_max_pct"] == pytest.approx(0.5)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "position", [NOWHERE, np.where(T_S < 0.0005, 1.0, np.nan), np.full(T_S.size, 3.0)]
)
def test_run_without_a_measured_range_has_no_measured_errors(position: np.ndarray) -> None:
    """It has a single sample, or a constant position."""
    errors = errors_pct(tuple(MEASURED), COMMAND, position, COMMAND)

    assert np.isnan(list(errors.values())).all()


@pytest.mark.filterwarnings("error")
def test_constant_command_has_no_errors_in_per_cent() -> None:
    """The only range would be that of the noise, and one point defines no line."""
    position = np.array([9.9, 10.0, 10.1])

    errors = errors_pct(ALL, np.full(3, 10.0), position, position)

    assert np.isnan(list(errors.values())).all()


@pytest.mark.filterwarnings("error")
def test_stage_that_does_not_move_has_no_true_errors() -> None:
    """Its sensor shows noise, and there is no range to relate it to."""
    errors = errors_pct(NEED_TRUTH, COMMAND, 0.01 * COMMAND, np.zeros(T_S.size))

    assert np.isnan(list(errors.values())).all()
