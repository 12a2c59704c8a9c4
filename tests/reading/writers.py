"""The record of the laboratory in files of other programs."""

from collections.abc import Callable
from pathlib import Path

import h5py
import nptdms
import numpy as np
import openpyxl
import pyarrow as pa
from pyarrow import parquet
from scipy import io as scipy_io

from tests.reading.lab import COLUMNS, DRIVE_V, NAMES, POSITION_UM, T_S


def xlsx(path: Path) -> None:
    """Write an .xlsx file with a title, units, remarks and another sheet."""
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Record of stage 7"])
    sheet.append(["Time", "Drive", "Position", "Remark"])
    sheet.append(["s", "V", "um", ""])
    for row in zip(*COLUMNS.values(), strict=True):
        sheet.append([*map(float, row), "ok"])
    book.create_sheet("Notes").append(["none", 1.0])
    book.save(path)


def mat(path: Path) -> None:
    """Write variables of MATLAB."""
    scipy_io.savemat(path, {**COLUMNS, "operator": "Müller", "gain": 2.5})


def mat_of_struct(path: Path) -> None:
    """Write a struct of MATLAB, compressed."""
    scipy_io.savemat(path, {"data": {**COLUMNS, "about": {"rate": 1000.0}}}, do_compression=True)


def mat73(path: Path) -> None:
    """Write what MATLAB 7.3 writes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in COLUMNS.items():
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["#refs#/a"] = values
        file["title"] = np.frombuffer(b"abc", np.uint8)[None, :]
        file["title"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Fri Nov 27".ljust(124))


def hdf5(path: Path) -> None:
    """Write a group with units, and what cannot be read beside it."""
    with h5py.File(path, "w") as file:
        group = file.create_group("scan/axis")
        for name, unit, (_, values) in zip(
            ("time", "voltage", "displacement"), ("s", "V", "um"), COLUMNS.items(), strict=True
        ):
            group.create_dataset(name, data=values, compression="lzf", chunks=(100,))
            group[name].attrs["units"] = unit
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/data")
        file["remark"] = "none"


def npz(path: Path) -> None:
    """Write named arrays."""
    arrays = {"t_s": T_S, "drive_v": DRIVE_V, "position_um": POSITION_UM}
    with path.open("wb") as file:  # with a name numpy appends its ending
        np.savez(file, note=np.array("a text"), **arrays)  # type: ignore[arg-type]  # a flag, too


def npy_with_names(path: Path) -> None:
    """Write an array with fields."""
    table = np.zeros(T_S.size, [(name, "f8") for name in NAMES])
    for name in NAMES:
        table[name] = COLUMNS[name]
    with path.open("wb") as file:
        np.save(file, table)


def columnar(path: Path) -> None:
    """Write a table with units in its metadata."""
    fields = [
        pa.field(name, pa.float64(), metadata={"units": unit})
        for name, unit in (("time", "s"), ("drive", "V"), ("position", "µm"))
    ]
    arrays = [*map(pa.array, COLUMNS.values())]
    parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)


def tdms(path: Path) -> None:
    """Write channels with units, whose time is an interval."""
    properties = {"wf_increment": 0.001, "wf_start_offset": 0.0}
    channels = [
        nptdms.ChannelObject("Scan", name, values, {**properties, "unit_string": unit})
        for name, unit, values in (("Drive", "V", DRIVE_V), ("Position", "um", POSITION_UM))
    ]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)


WRITERS: dict[str, Callable[[Path], None]] = {
    "a.xlsx": xlsx,
    "a.mat": mat,
    "struct.mat": mat_of_struct,
    "v73.mat": mat73,
    "a.h5": hdf5,
    "a.npz": npz,
    "a.npy": npy_with_names,
    "a.parquet": columnar,
    "a.tdms": tdms,
}
