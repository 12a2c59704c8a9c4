from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

from piezod.errors import DataError
from piezod.records.experiment_result import (
    COLUMN_NAMES,
    ExperimentResult,
    Identification,
    Recording,
)


@pytest.mark.parametrize("name", [*COLUMN_NAMES, "weights", "weights_t_s"])
def test_arrays_are_read_only(recording: Recording, name: str) -> None:
    """No array of a recording can be written to."""
    with pytest.raises(ValueError, match="read-only"):
        getattr(recording, name)[0] = 1.0


def test_fields_are_frozen(recording: Recording) -> None:
    """No field of a recording can be replaced."""
    with pytest.raises(FrozenInstanceError):
        recording.case = "other"  # type: ignore[misc]  # that it is refused is the fact


def test_caller_keeps_a_writable_array(recording: Recording) -> None:
    """A recording copies its arrays: the caller's arrays stay writable and separate."""
    mine = np.zeros(recording.t_s.size)

    other = replace(recording, drive_v=mine)
    mine[0] = 5.0

    assert other.drive_v[0] == 0.0


def test_mappings_are_read_only_copies(recording: Recording) -> None:
    """Metrics cannot be changed, neither through the recording nor through the caller's dict."""
    mine = {"nonlinearity_pct": 1.0}
    other = replace(recording, metrics=mine)
    mine["nonlinearity_pct"] = 2.0

    assert dict(other.metrics) == {"nonlinearity_pct": 1.0}
    with pytest.raises(TypeError):
        other.metrics["nonlinearity_pct"] = 3.0  # type: ignore[index]  # refused is the fact


def test_integers_become_doubles(recording: Recording) -> None:
    """A column of integers is kept as float64."""
    integers: Any = [1] * recording.t_s.size

    other = replace(recording, command_um=integers)

    assert other.command_um.dtype == np.float64


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"drive_v": np.zeros(3)}, "columns differ in length .t_s 400, drive_v 3"),
        ({"t_s": np.zeros((400, 1))}, "t_s has 2 dimensions; allowed is 1"),
        ({"weights": np.zeros(4)}, "weights has 1 dimensions; allowed is 2"),
        ({"weights": np.zeros((3, 38))}, r"shape \(3, 38\); allowed is \(40, 2M\)"),
        ({"weights": np.zeros((40, 37))}, r"shape \(40, 37\); allowed is \(40, 2M\)"),
        ({"weights": np.zeros((3, 5)), "surface": True}, r"\(3, 5\); allowed is \(40, 2M\)"),
        ({"first_metric_index": 400}, "first_metric_index is 400; allowed is 0 to 399"),
        ({"first_metric_index": -1}, "first_metric_index is -1"),
        ({"position_um": ["a"] * 400}, "position_um does not consist of numbers"),
        (dict.fromkeys(COLUMN_NAMES, np.empty(0)), "there are no samples"),
    ],
)
def test_shapes_that_do_not_go_together_are_refused(
    recording: Recording, changes: dict[str, Any], said: str
) -> None:
    """Wrong shapes raise a DataError that names the recording and the problem."""
    with pytest.raises(DataError, match=f"^recording x/case 1/adaptive: .*{said}"):
        replace(recording, **changes)


def test_identification_columns_must_be_of_one_length(identification: Identification) -> None:
    """An identification whose columns differ in length is refused."""
    with pytest.raises(DataError, match="identification of x: columns differ in length"):
        replace(identification, predicted_v=np.zeros(2))


def test_identification_without_a_record() -> None:
    """A model read from a file has an identification without samples, of range 0."""
    none = np.empty(0)
    loaded = Identification("x", "model.yaml", "read from file", none, none, none, none)

    assert loaded.drive_range_v == 0.0


def test_parameters_are_read_only(identification: Identification) -> None:
    """The model parameters inside an identification cannot be written to."""
    with pytest.raises(ValueError, match="read-only"):
        identification.parameters["thresholds"][0] = 1.0


def test_range_counts_the_samples_of_the_metrics_only(recording: Recording) -> None:
    """The displacement range leaves out excluded and invalid samples."""
    position_um = np.full(400, 2.0)
    position_um[:200] = -50.0
    position_um[300] = np.nan
    position_um[301] = 5.0

    assert replace(recording, position_um=position_um).position_range_um == 3.0


def test_truth_is_known_or_not(recording: Recording, simulated: ExperimentResult) -> None:
    """The true error is true minus commanded; one known sample suffices."""
    known = simulated.recordings[2]
    assert np.array_equal(known.true_error_um, known.command_um - known.true_um)

    once = np.full(400, np.nan)
    once[7] = 1.0
    assert known.knows_truth
    assert replace(recording, true_um=once).knows_truth
    assert not recording.knows_truth


def test_derived_columns(recording: Recording, identification: Identification) -> None:
    """Error is commanded minus measured, residual is predicted minus applied."""
    assert np.array_equal(recording.error_um, recording.command_um - recording.position_um)
    assert np.array_equal(
        identification.residual_v, identification.predicted_v - identification.drive_v
    )


def test_equality_is_by_value(make_recording: Callable[..., Recording]) -> None:
    """Recordings of equal data are equal, NaN included; one different sample makes them differ."""
    one, two = (make_recording("x", "case 1", "adaptive") for _ in range(2))
    gap_um = one.position_um.copy()
    gap_um[3] = np.nan

    assert one == two
    assert replace(one, position_um=gap_um) == replace(two, position_um=gap_um)
    assert one != replace(two, position_um=gap_um)
    assert replace(one, metrics={"a": float("nan")}) == replace(two, metrics={"a": float("nan")})
    assert one != replace(two, metrics={"a": 1.0})
    assert one != "a recording"


def test_names_come_in_the_order_of_their_first_appearance(two_axes: ExperimentResult) -> None:
    """Axes, cases, modes and metrics keep the order of the runs."""
    assert two_axes.axes == ("x", "y")
    assert two_axes.cases == ("case 1", "b")
    assert two_axes.modes == ("uncompensated", "feedforward", "adaptive")
    assert two_axes.metric_names == ("tracking_max_pct", "tracking_rms_pct", "nonlinearity_pct")


def test_one_recording_twice_is_refused(result: ExperimentResult, recording: Recording) -> None:
    """Axis, case and mode identify a recording, so a duplicate is refused."""
    with pytest.raises(DataError, match="recording x/case 1/adaptive appears 2 times"):
        replace(result, recordings=(*result.recordings, recording))
