"""The errors of a run: measured, true, and what the sensor adds."""

from typing import get_args

import numpy as np
import pytest

from piezod.config.experiment_fields import Metric
from piezod.experiment.error_rows import MEASURED, NEED_TRUTH, NOISE, TRUE, errors_pct

T_S = np.arange(4000) / 1000.0
COMMAND = 5.0 - 5.0 * np.cos(2.0 * np.pi * T_S)
NOWHERE = np.full(T_S.size, np.nan)
ALL = (*MEASURED, *TRUE, *NOISE)


def test_there_is_a_function_for_every_metric_that_a_file_may_name() -> None:
    """And none that no file can name."""
    assert set(get_args(Metric)) == set(ALL)


def test_true_errors_are_those_of_the_truth() -> None:
    """They are the measured ones of a sensor that measures the truth, under names of their own."""
    truth = COMMAND + 0.1 * np.sin(2.0 * np.pi * T_S)
    position = truth + 0.3 * np.sin(40.0 * T_S)

    errors = errors_pct(ALL, COMMAND, position, truth)
    perfect = errors_pct(ALL, COMMAND, truth, truth)

    assert errors["true_tracking_max_pct"] == perfect["tracking_max_pct"] == pytest.approx(1.0, 0.1)
    assert errors["true_nonlinearity_pct"] == perfect["nonlinearity_pct"]
    assert errors["nonlinearity_pct"] > 2.0 * errors["true_nonlinearity_pct"]
    assert errors["noise_rms_pct"] == pytest.approx(2.1, abs=0.1)
    assert perfect["noise_rms_pct"] == pytest.approx(0.0, abs=1e-9)


def test_errors_come_in_the_order_asked_for() -> None:
    """Those of the file, and no others."""
    names = ("noise_rms_pct", "true_nonlinearity_pct", "tracking_max_pct")

    assert tuple(errors_pct(names, COMMAND, COMMAND, COMMAND)) == names


def test_what_is_not_known_has_no_true_errors() -> None:
    """The measured ones are there all the same."""
    errors = errors_pct(ALL, COMMAND, COMMAND + 0.1, NOWHERE)

    assert {name for name, value in errors.items() if np.isnan(value)} == set(NEED_TRUTH)
    assert errors["tracking_max_pct"] == pytest.approx(1.0)


def test_errors_leave_out_invalid_samples() -> None:
    """Where nothing was measured there is no error, not a zero, and no true one either."""
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
def test_a_run_that_measured_nothing_has_no_measured_errors(position: np.ndarray) -> None:
    """Neither has one with a single sample, nor one whose sensor stood still."""
    errors = errors_pct(tuple(MEASURED), COMMAND, position, COMMAND)

    assert np.isnan(list(errors.values())).all()


@pytest.mark.filterwarnings("error")
def test_a_constant_command_has_no_errors_in_per_cent() -> None:
    """There is no range but that of the noise, and no line through one point."""
    position = np.array([9.9, 10.0, 10.1])

    errors = errors_pct(ALL, np.full(3, 10.0), position, position)

    assert np.isnan(list(errors.values())).all()


@pytest.mark.filterwarnings("error")
def test_a_stage_that_does_not_move_has_no_true_errors() -> None:
    """What its sensor shows is noise, the share of a range that is not there."""
    errors = errors_pct(NEED_TRUTH, COMMAND, 0.01 * COMMAND, np.zeros(T_S.size))

    assert np.isnan(list(errors.values())).all()
