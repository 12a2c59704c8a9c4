"""Tests of the samples just after a stall of the loop."""

from dataclasses import replace

import numpy as np
import pytest

from piezod.experiment.live.late import (
    SETTLING_CYCLES,
    late_indices,
    late_note,
)
from piezod.experiment.session.runs import judged_errors_pct
from piezod.records.experiment_result import Recording

METRICS = ("tracking_max_pct", "tracking_rms_pct")
N = 1000


def recording(late: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Recording:
    """Return a run that is 0.1 % off its command, and 5 % off in the samples that are late."""
    t_s = np.arange(N) / 1000.0
    command_um = 10.0 * np.linspace(0.0, 1.0, N)
    position_um = command_um.copy()
    position_um[::2] += 0.01
    position_um[late] += 0.5
    return Recording(
        axis="x",
        case="slow",
        mode="adaptive",
        title="",
        t_s=t_s,
        drive_v=command_um,
        position_um=position_um,
        command_um=command_um,
        uncompensated_v=command_um,
        true_um=np.full(N, np.nan),
        late_t_s=t_s[late],
    )


def test_samples_after_each_gap_are_late() -> None:
    """The number of skipped periods rises at the first sample after a gap."""
    skipped = np.zeros(N, np.int64)
    skipped[100:] += 1
    skipped[103:] += 40
    skipped[N - 2 :] += 1

    late = late_indices(skipped)

    last = 103 + SETTLING_CYCLES
    assert late.tolist() == [*range(100, last), N - 2, N - 1]
    assert late_indices(np.full(N, 7)).size == 0


def test_errors_leave_late_samples_out_and_the_note_says_what_they_change() -> None:
    """The official error is that of the compensation; the other one is told."""
    run = recording(np.arange(500, 506))
    run = replace(run, metrics=judged_errors_pct(run, METRICS, with_late=False))

    assert run.metrics["tracking_max_pct"] == pytest.approx(0.1, rel=0.2)
    assert late_note(run, METRICS) == (
        "6 of 1000 samples came just after a stall of the loop and are left out of the errors; "
        "with them: tracking_max_pct 5.11 in place of 0.1, "
        "tracking_rms_pct 0.398 in place of 0.0708."
    )


def test_late_samples_in_the_run_in_change_nothing() -> None:
    """The run-in does not count in any case."""
    run = replace(recording(np.arange(10, 16)), first_metric_index=100)
    run = replace(run, metrics=judged_errors_pct(run, METRICS, with_late=False))

    assert run.metrics["tracking_max_pct"] == pytest.approx(0.1, rel=0.2)
    assert late_note(run, METRICS).endswith("with them: the same errors.")


def test_too_many_late_samples_are_not_left_out() -> None:
    """A run that was mostly stalls must not look good."""
    run = recording(np.arange(300, 450))
    run = replace(run, metrics=judged_errors_pct(run, METRICS, with_late=False))

    assert run.metrics["tracking_max_pct"] == pytest.approx(5.1, rel=0.1)
    assert "too many to leave them out" in late_note(run, METRICS)


def test_punctual_run_needs_no_note() -> None:
    """Nothing is said if nothing was late."""
    assert late_note(recording(np.arange(0)), METRICS) == ""
