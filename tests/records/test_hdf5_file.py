from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.errors import DataError
from piezod.records.experiment_file import read_hdf5, write_hdf5
from piezod.records.experiment_result import ExperimentResult, Identification, Recording


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return the path of the file that a test writes."""
    return tmp_path / "run.h5"


def _written(path: Path, result: ExperimentResult) -> ExperimentResult:
    write_hdf5(path, result)
    return read_hdf5(path)


def test_experiment_comes_back_equal(file: Path, result: ExperimentResult) -> None:
    """The read experiment equals the written one, to the last bit and in the same order."""
    assert _written(file, result) == result


def test_true_displacement_comes_back(
    file: Path, result: ExperimentResult, simulated: ExperimentResult
) -> None:
    """If it is known, it survives, and the file offers it to viewers."""
    assert _written(file, simulated) == simulated
    with h5py.File(file) as root:
        beside = list(root["experiment/x_b_adaptive"].attrs["auxiliary_signals"])
    write_hdf5(file, result)
    with h5py.File(file) as root:
        without = list(root["experiment/x_b_adaptive"].attrs["auxiliary_signals"])

    assert beside == ["command_um", "true_um", "drive_v", "uncompensated_v"]
    assert without == ["command_um", "drive_v", "uncompensated_v"]


def test_several_axes_come_back_equal(file: Path, two_axes: ExperimentResult) -> None:
    """Recordings of several axes keep their order, x before y."""
    read = _written(file, two_axes)

    assert read == two_axes
    assert [each.key for each in read.recordings] == [each.key for each in two_axes.recordings]


def test_invalid_samples_and_odd_metrics_come_back(
    file: Path, result: ExperimentResult, recording: Recording
) -> None:
    """NaN positions, infinite metrics and more than a handful of metrics survive."""
    position_um = recording.position_um.copy()
    position_um[17] = np.nan
    metrics = {f"metric_{10 - i}_pct": float(i) for i in range(10)} | {"worst_pct": float("inf")}
    odd = replace(recording, position_um=position_um, metrics=metrics)

    read = _written(file, replace(result, recordings=(odd,)))

    assert read.recordings == (odd,)
    assert list(read.recordings[0].metrics) == list(metrics)


def test_weights_without_sides_come_back(
    file: Path, result: ExperimentResult, recording: Recording
) -> None:
    """A model whose weights belong to no side may have an odd number of them."""
    weights = np.zeros((recording.weights_t_s.size, 5))
    one_sided = replace(recording, weights=weights, surface=True)

    read = _written(file, replace(result, recordings=(one_sided,)))

    assert read.recordings == (one_sided,)
    assert read.recordings[0].surface


def test_model_without_a_record_comes_back(file: Path, result: ExperimentResult) -> None:
    """An identification without samples and an experiment without recordings survive."""
    none = np.empty(0)
    loaded = Identification("x", "model.yaml", "read from file", none, none, none, none)
    bare = replace(result, recordings=(), identifications=(loaded,), versions={})

    assert _written(file, bare) == bare


def test_experiment_without_any_data_comes_back(file: Path, result: ExperimentResult) -> None:
    """An experiment without any data survives too."""
    bare = replace(result, recordings=(), identifications=())

    assert _written(file, bare) == bare


def test_names_that_differ_in_signs_only_are_kept_apart(
    file: Path, result: ExperimentResult, recording: Recording
) -> None:
    """Cases whose names are equal in NeXus's characters get different groups."""
    alike = tuple(replace(recording, case=case) for case in ("b c", "b-c", "b_c"))

    read = _written(file, replace(result, recordings=alike))

    assert [each.case for each in read.recordings] == ["b c", "b-c", "b_c"]


def test_defaults_lead_to_a_plot(file: Path, result: ExperimentResult) -> None:
    """Following @default from the root ends at data with a signal and an axis of one length."""
    write_hdf5(file, result)

    with h5py.File(file) as root:
        node = root
        classes = [node.attrs["NX_class"]]
        while "default" in node.attrs:
            node = node[node.attrs["default"]]
            classes.append(node.attrs["NX_class"])
        signal, axis = node[node.attrs["signal"]], node[node.attrs["axes"]]

        assert classes == ["NXroot", "NXentry", "NXdata"]
        assert signal.shape == axis.shape
        assert signal.attrs["units"] == "um"
        assert axis.attrs["units"] == "s"
        assert all(name in node for name in node.attrs["auxiliary_signals"])


def test_every_group_has_a_class_and_every_column_a_unit_and_a_name(
    file: Path, result: ExperimentResult
) -> None:
    """Each group has its NeXus class, each dataset its unit and its long name."""
    write_hdf5(file, result)
    without: list[str] = []

    def visit(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Group):
            wanted = {"NX_class"}
        elif node.parent.attrs["NX_class"] == "NXdata" and not name.endswith("/title"):
            wanted = {"units", "long_name"}
        else:
            return
        if not wanted <= set(node.attrs):
            without.append(name)

    with h5py.File(file) as root:
        root.visititems(visit)
        names = list(root["experiment"])

    assert without == []
    assert "x_case_1_uncompensated" in names
    assert "identification_x" in names


def test_metrics_are_attributes(file: Path, result: ExperimentResult) -> None:
    """The errors are attributes beside the columns that they were computed from."""
    write_hdf5(file, result)

    with h5py.File(file) as root:
        metrics = dict(root["experiment/x_b_adaptive/metrics"].attrs)

    assert metrics.pop("NX_class") == "NXcollection"
    assert metrics == dict(result.recordings[-1].metrics)


def test_same_experiment_gives_the_same_bytes(tmp_path: Path, result: ExperimentResult) -> None:
    """Two writes give the same file: it contains no time of writing."""
    one, two = tmp_path / "one.h5", tmp_path / "two.h5"
    write_hdf5(one, result)
    write_hdf5(two, result)

    assert one.read_bytes() == two.read_bytes()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["one.h5", "two.h5"]


def test_file_of_somebody_else_is_refused(file: Path) -> None:
    """An HDF5 file with another layout is refused with its name."""
    with h5py.File(file, "w") as other:
        other["data"] = [1, 2, 3]

    with pytest.raises(DataError, match=r"run\.h5: this is not the record of an experiment"):
        read_hdf5(file)


def test_incomplete_file_is_refused(file: Path, result: ExperimentResult) -> None:
    """A file that lacks a column is refused with the name of the column."""
    write_hdf5(file, result)
    with h5py.File(file, "a") as root:
        del root["experiment/x_b_adaptive/drive_v"]

    with pytest.raises(DataError, match="drive_v"):
        read_hdf5(file)


def test_file_that_is_not_hdf5_is_refused(file: Path) -> None:
    """A text file is another one than the record of an experiment."""
    file.write_text("text", encoding="utf-8")

    with pytest.raises(DataError, match="not an HDF5 file"):
        read_hdf5(file)


def test_warnings_come_back(file: Path, result: ExperimentResult) -> None:
    """Warnings survive with all their characters and in their order."""
    warned = replace(result, warnings=("1 % of x; zürück.", "", "0 µm"))

    assert _written(file, warned) == warned


def test_late_samples_come_back(file: Path, result: ExperimentResult) -> None:
    """Their instants are stored, with unit and meaning, in recordings that have some."""
    first, *others = result.recordings
    marked = replace(result, recordings=(replace(first, late_t_s=first.t_s[3:9]), *others))

    assert _written(file, marked) == marked
    with h5py.File(file) as root:
        (late,) = [
            group["late_t_s"]
            for group in root["experiment"].values()
            if isinstance(group, h5py.Group) and "late_t_s" in group
        ]
        assert late.attrs["units"] == "s"
        assert "stall" in late.attrs["long_name"]


def test_surface_comes_back(file: Path, recording: Recording, result: ExperimentResult) -> None:
    """24 coefficients come back as those of a surface; the file describes them."""
    surface = replace(recording, weights=recording.weights[:, :23], surface=True)
    whole = replace(result, recordings=(surface,))

    (read,) = _written(file, whole).recordings

    assert read.surface
    assert read == surface
    with h5py.File(file) as opened:
        weights = next(
            each["weights"] for each in opened["experiment"].values() if "mode" in each.attrs
        )
        assert weights.attrs["long_name"].startswith("coefficients of the surface")
