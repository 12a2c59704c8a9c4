"""HDF5 output and input in the layout of NeXus, so that its viewers open a useful plot.

::

    /                             NXroot   @default
      experiment/                 NXentry  @default
        title, seed, rate_hz, warnings
        configuration/data        NXnote: the text of the file
        versions/                 NXcollection of attributes
        identification_<axis>/    NXdata   @signal=drive_v @axes=t_s @axis @method
          t_s, drive_v, position_um, predicted_v     each with @units and @long_name
          parameters/             NXcollection of arrays
          fit_errors/             NXcollection of attributes
        <axis>_<case>_<mode>/     NXdata   @signal=position_um @axes=t_s @axis @case @mode
          t_s, drive_v, position_um, command_um, uncompensated_v, true_um     likewise
          weights, weights_t_s                       likewise
          late_t_s                                   likewise, if samples were late
          metrics/                NXcollection of attributes
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from piezod.errors import DataError
from piezod.reading.opened import MOST_READ_BYTES, damage_is_an_error, open_recording
from piezod.records.atomic import replacing
from piezod.records.experiment_result import (
    COLUMN_NAMES,
    FIT_COLUMN_NAMES,
    ExperimentResult,
    Identification,
    Recording,
)
from piezod.records.frozen import FloatArray
from piezod.records.nexus import (
    new_collection,
    new_column,
    new_data,
    new_entry,
    new_group,
)

_ENTRY: Final = "experiment"
_LONG_NAMES: Final = {
    "t_s": "time",
    "drive_v": "voltage applied",
    "position_um": "measured displacement",
    "command_um": "commanded displacement",
    "uncompensated_v": "voltage without compensation",
    "true_um": "true displacement, known to a simulated device only",
    "predicted_v": "voltage predicted by the model",
    "weights": "parameters of the compensator, those of the right operators first",
    "weights_t_s": "time of the parameters",
    "late_t_s": "time of samples just after a stall of the loop",
}
_COEFFICIENTS: Final = "coefficients of the surface, four for each of six widths"


def write_hdf5(path: Path, result: ExperimentResult) -> None:
    """Write all data of an experiment.

    Args:
        path: Path of the file; it is written completely or not at all.
        result: The experiment.

    Raises:
        OSError: If the file cannot be written.
    """
    with replacing(path) as temporary, h5py.File(temporary, "w", track_order=True) as file:
        entry = new_entry(file, _ENTRY)
        entry["title"] = result.title
        entry["seed"] = result.seed
        entry["rate_hz"] = result.rate_hz
        entry["rate_hz"].attrs["units"] = "Hz"
        warnings = list(result.warnings)
        entry.create_dataset("warnings", data=warnings, dtype=h5py.string_dtype())
        note = new_group(entry, "configuration", "NXnote")
        note["type"] = "application/yaml"
        note["data"] = result.configuration
        new_collection(entry, "versions", result.versions)
        written = [_write_identification(entry, each) for each in result.identifications]
        written += [_write_recording(entry, each) for each in result.recordings]
        if written:  # what a viewer shows first: the last run, or a model if there is no run
            entry.attrs["default"] = written[-1]


def read_hdf5(path: Path) -> ExperimentResult:
    """Return the experiment that `write_hdf5` wrote.

    Returns:
        An experiment equal to the written one.

    Raises:
        DataError: If the file has another layout.
        OSError: If the file cannot be opened.
    """
    with open_recording(path) as file, damage_is_an_error(path):
        try:
            _check_room(file)
            return _read_entry(file[_ENTRY])
        except KeyError as error:
            raise DataError(
                f"{path}: this is not the record of an experiment: {error.args[0]}; allowed are "
                "files written by write_hdf5; open other files with an HDF5 viewer"
            ) from error


def _write_identification(entry: h5py.Group, identification: Identification) -> str:
    name = f"identification_{identification.axis}"
    group = _data_group(entry, name, "drive_v", identification.columns())
    group["title"] = identification.title
    group.attrs["auxiliary_signals"] = ["predicted_v", "position_um"]
    group.attrs["axis"] = identification.axis
    group.attrs["method"] = identification.method
    parameters = new_group(group, "parameters", "NXcollection")
    for parameter, values in identification.parameters.items():
        parameters.create_dataset(parameter, data=values)
    new_collection(group, "fit_errors", identification.fit_errors)
    return _base_name(group)


def _write_recording(entry: h5py.Group, recording: Recording) -> str:
    group = _data_group(entry, "_".join(recording.key), "position_um", recording.columns())
    group["title"] = recording.title
    group.attrs["auxiliary_signals"] = _auxiliary(recording)
    group.attrs["axis"] = recording.axis
    group.attrs["case"] = recording.case
    group.attrs["mode"] = recording.mode
    group.attrs["first_metric_index"] = recording.first_metric_index
    new_column(group, "weights", recording.weights, _LONG_NAMES["weights"])
    if recording.surface:
        group["weights"].attrs["surface"] = True
        group["weights"].attrs["long_name"] = _COEFFICIENTS
    new_column(group, "weights_t_s", recording.weights_t_s, _LONG_NAMES["weights_t_s"])
    if recording.late_t_s.size:
        new_column(group, "late_t_s", recording.late_t_s, _LONG_NAMES["late_t_s"])
    new_collection(group, "metrics", recording.metrics)
    return _base_name(group)


def _auxiliary(recording: Recording) -> list[str]:
    """Return the columns that a viewer draws beside the measured displacement."""
    known = ["true_um"] if recording.knows_truth else []
    return ["command_um", *known, "drive_v", "uncompensated_v"]


def _data_group(
    entry: h5py.Group, name: str, signal: str, columns: Mapping[str, FloatArray]
) -> h5py.Group:
    group = new_data(entry, _free_name(entry, name), signal)
    for column, values in columns.items():
        new_column(group, column, values, _LONG_NAMES[column])
    return group


def _free_name(entry: h5py.Group, name: str) -> str:
    """Return an unused name of the characters that NeXus allows."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name)
    number = 1
    while (free := plain if number == 1 else f"{plain}_{number}") in entry:
        number += 1
    return free


def _base_name(group: h5py.Group) -> str:
    return str(group.name).rsplit("/", maxsplit=1)[-1]


def _check_room(file: h5py.File) -> None:
    sizes: list[int] = []
    file.visititems(
        lambda _, each: sizes.append(each.nbytes) if isinstance(each, h5py.Dataset) else None
    )
    if sum(sizes) > MOST_READ_BYTES:
        what = f"its data need {sum(sizes) / 1e9:.1f} GB"
        raise DataError(f"{what}; allowed: {MOST_READ_BYTES / 1e9:.0f} GB; use an HDF5 viewer")


def _read_entry(entry: h5py.Group) -> ExperimentResult:
    return ExperimentResult(
        title=_text(entry["title"]),
        recordings=tuple(map(_read_recording, _data_groups(entry, "mode"))),
        identifications=tuple(map(_read_identification, _data_groups(entry, "method"))),
        configuration=_text(entry["configuration/data"]),
        versions=_read_attributes(entry["versions"]),
        seed=int(entry["seed"][()]),
        rate_hz=float(entry["rate_hz"][()]),
        warnings=tuple(entry["warnings"].asstr()[()]),
    )


def _data_groups(entry: h5py.Group, attribute: str) -> Iterator[h5py.Group]:
    # The attribute tells the two kinds apart: only a recording has a mode, only a model a method.
    return (entry[name] for name in entry if attribute in entry[name].attrs)


def _read_identification(group: h5py.Group) -> Identification:
    return Identification(
        axis=group.attrs["axis"],
        title=_text(group["title"]),
        method=group.attrs["method"],
        fit_errors=_read_attributes(group["fit_errors"]),
        parameters={name: values[()] for name, values in group["parameters"].items()},
        **{name: group[name][()] for name in FIT_COLUMN_NAMES},
    )


def _read_recording(group: h5py.Group) -> Recording:
    return Recording(
        axis=group.attrs["axis"],
        case=group.attrs["case"],
        mode=group.attrs["mode"],
        title=_text(group["title"]),
        weights=group["weights"][()],
        weights_t_s=group["weights_t_s"][()],
        metrics=_read_attributes(group["metrics"]),
        first_metric_index=int(group.attrs["first_metric_index"]),
        late_t_s=group["late_t_s"][()] if "late_t_s" in group else np.empty(0),
        surface="surface" in group["weights"].attrs,
        **{name: group[name][()] for name in COLUMN_NAMES},
    )


def _read_attributes(collection: h5py.Group) -> dict[str, Any]:
    values = {name: value for name, value in collection.attrs.items() if name != "NX_class"}
    # A float again, so that the experiment read equals the one written.
    return {name: float(v) if isinstance(v, np.floating) else v for name, v in values.items()}


def _text(dataset: h5py.Dataset) -> str:
    return str(dataset.asstr()[()])
