"""Files that would hang, fill the memory, or lead elsewhere are refused before they are read."""

import os
from collections.abc import Callable
from pathlib import Path
from resource import RLIM_INFINITY, RLIMIT_AS, RLIMIT_CPU

import h5py
import numpy as np
import pytest

from piezod.errors import DataError
from piezod.reading import opened
from piezod.reading.hdf5_magic import is_hdf5
from piezod.reading.hdf5_structure import MOST_CHUNK_BYTES
from piezod.reading.opened import open_recording
from piezod.reading.record import read_record
from piezod.reading.table import MOST_COLUMNS
from piezod.reading.text import LONGEST_LINE
from piezod.records.experiment_file import read_hdf5
from piezod.records.recording.reader import read_telemetry
from piezod.records.recording.writer import TelemetryWriter
from piezod.records.view import RecordingView
from piezod.records.view_parts import contents
from tests.records.telemetry import header, record_dtype, records

READERS: list[Callable[[Path], object]] = [read_telemetry, RecordingView, contents]
COLUMN = "recording/axis_x/position_um"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a good recording."""
    path = tmp_path / "rec.h5"
    with TelemetryWriter(path, header(), record_dtype()) as writer:
        writer.append(records(0, 100))
    return path


def _link_out(file: h5py.File) -> None:
    del file[COLUMN]
    file[COLUMN] = h5py.ExternalLink("other.h5", "/data")


def _soft_link(file: h5py.File) -> None:
    del file[COLUMN]
    file[COLUMN] = h5py.SoftLink("/recording/cycles/t_s")


def _other_file(file: h5py.File) -> None:
    del file[COLUMN]
    file.create_dataset(COLUMN, (100,), "f8", external=[("/dev/zero", 0, h5py.h5f.UNLIMITED)])


def _pipe(file: h5py.File) -> None:
    del file[COLUMN]
    pipe = Path(file.filename).with_name("pipe")
    os.mkfifo(pipe)
    file.create_dataset(COLUMN, (100,), "f8", external=[(str(pipe), 0, 800)])


def _virtual(file: h5py.File) -> None:
    del file[COLUMN]
    layout = h5py.VirtualLayout((100,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "data", shape=(100,))
    file.create_virtual_dataset(COLUMN, layout)


def _bomb(file: h5py.File) -> None:
    del file[COLUMN]
    file.create_dataset(COLUMN, (2**36,), "f8", chunks=(2**20,), compression="gzip")


def _large_chunk(file: h5py.File) -> None:
    del file[COLUMN]
    rows = MOST_CHUNK_BYTES // 8 + 1
    file.create_dataset(
        COLUMN, (rows,), "f8", chunks=(rows,), compression="gzip", data=np.zeros(rows)
    )


def _filter(file: h5py.File) -> None:
    del file[COLUMN]
    file.create_dataset(COLUMN, data=np.zeros(100), compression="lzf")


def _loop(file: h5py.File) -> None:
    file["recording/axis_x/recording"] = file["recording"]


def _name(file: h5py.File) -> None:
    file["recording/" + "n" * 30_000] = 1


def _compound(file: h5py.File) -> None:
    file["recording/more"] = np.zeros(3, [("a", "f8"), ("b", "i4")])


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(
    "spoil",
    [
        _link_out, _soft_link, _other_file, _pipe, _virtual, _bomb, _large_chunk, _filter, _loop,
        _name, _compound,
    ],
)  # fmt: skip
@pytest.mark.few(12)
def test_structure_that_was_never_written_is_refused(
    file: Path, spoil: Callable[[h5py.File], None], read: Callable[[Path], object]
) -> None:
    """Nothing outside the file is opened, and nothing large is expanded."""
    with h5py.File(file, "r+", libver="v110") as root:
        spoil(root)

    with pytest.raises(DataError) as caught:
        read(file)

    assert str(caught.value).startswith(f"{file}: ")


@pytest.mark.parametrize("read", [*READERS, read_hdf5, read_record, is_hdf5])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_regular_file_is_refused(
    tmp_path: Path, read: Callable[[Path], object], kind: str
) -> None:
    """A pipe would wait for a writer, and a device never ends."""
    path = {"pipe": tmp_path / "pipe", "device": Path("/dev/zero"), "folder": tmp_path}[kind]
    if kind == "pipe":
        os.mkfifo(path)

    with pytest.raises(DataError, match="allowed is a regular file"):
        read(path)


@pytest.mark.parametrize(
    "content",
    [
        b"1," * LONGEST_LINE,
        b",".join(b"c%d" % number for number in range(MOST_COLUMNS + 1)) + b"\n",
        b't_s,drive_v,position_um\n"' + b"1,2,3\n" * 100_000,
    ],
)
def test_very_wide_table_is_refused(tmp_path: Path, content: bytes) -> None:
    """Lines, columns and fields are bounded before they are split."""
    path = tmp_path / "wide.csv"
    path.write_bytes(content)

    with pytest.raises(DataError, match=r"allowed|which column"):
        read_record(path)


@pytest.mark.usefixtures("looks_elsewhere")
def test_other_process_refuses_the_same(file: Path) -> None:
    """What the process that looks first has found is the text of the error."""
    assert len(read_telemetry(file).cycles["t_s"]) == 100
    with h5py.File(file, "r+", libver="v110") as root:
        _soft_link(root)

    with pytest.raises(DataError, match="a link, which may lead anywhere"):
        read_telemetry(file)


@pytest.mark.usefixtures("looks_elsewhere")
@pytest.mark.parametrize("body", ["import os; os.abort()", "while True: pass", "bytearray(10**13)"])
def test_hdf5_that_fails_costs_another_process(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str
) -> None:
    """A crash, an endless loop and a huge allocation of HDF5 are an error of the file."""
    (tmp_path / "failing_look.py").write_text(body, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(opened, "_LOOK", "failing_look")
    monkeypatch.setattr(opened, "LOOK_WITHIN_S", 0.5)

    with pytest.raises(DataError, match="damaged"):
        open_recording(file)


def test_process_with_both_bounds_looks_itself(
    monkeypatch: pytest.MonkeyPatch, looks_here: Callable[[], bool]
) -> None:
    """A process with a bound of memory alone may still loop for ever."""
    found = dict.fromkeys((RLIMIT_AS, RLIMIT_CPU), (10**9, 10**9))
    monkeypatch.setattr("piezod.resource_limits.resource.getrlimit", lambda kind: found[kind])
    both = looks_here()
    found[RLIMIT_CPU] = (RLIM_INFINITY, RLIM_INFINITY)

    assert (both, looks_here()) == (True, False)
