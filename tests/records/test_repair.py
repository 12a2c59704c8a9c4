"""Recordings whose writer was killed."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.errors import DataError
from piezod.records.lookup3 import lookup3
from piezod.records.recording.reader import read_telemetry
from piezod.records.recording.writer import TelemetryWriter
from piezod.records.repair import repair
from tests.records.killed import killed
from tests.records.telemetry import header, record_dtype, records


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return the path of a recording."""
    return tmp_path / "killed.h5"


@pytest.mark.parametrize(
    ("text", "checksum"),
    [
        (b"", 0xDEADBEEF),
        (b"Four score and seven years ago", 0x17770551),
    ],
)
def test_checksum_is_that_of_its_author(text: bytes, checksum: int) -> None:
    """The values are those that the author's `driver5` prints, with a start value of 0."""
    assert lookup3(text) == checksum


@pytest.mark.fault("P8")
@pytest.mark.parametrize("n_records", [5250, 300, 50])
def test_killed_recording_opens_plainly_after_a_repair(file: Path, n_records: int) -> None:
    """All records are there but those of the last second, or of the last half of a short one."""
    killed(file, n_records)
    with pytest.raises(OSError, match="already open for write"):
        h5py.File(file)

    assert repair(file)
    with h5py.File(file) as root:
        seqs = root["recording/cycles/seq"][:]
        positions_um = root["recording/axis_x/position_um"][:]

    kept = n_records // 1000 * 1000 or n_records / 2
    assert len(seqs) >= kept
    assert len(positions_um) == len(seqs)
    np.testing.assert_array_equal(seqs, np.arange(len(seqs)))
    np.testing.assert_array_equal(read_telemetry(file).cycles["seq"], seqs)


def test_closed_recording_is_left_alone(file: Path) -> None:
    """A second repair, and one of a file that was closed, change no byte."""
    with TelemetryWriter(file, header(), record_dtype()) as writer:
        writer.append(records(0, 100))
    before = file.read_bytes()

    assert not repair(file)
    assert file.read_bytes() == before


def test_recording_in_progress_is_refused(file: Path) -> None:
    """The flags of a file that is being written stay."""
    with TelemetryWriter(file, header(), record_dtype()) as writer:
        writer.append(records(0, 1000))
        with pytest.raises(DataError, match="still being written"):
            repair(file)
        meanwhile = read_telemetry(file).cycles["seq"].size

    assert meanwhile == 1000
    assert not repair(file)


@pytest.mark.parametrize(
    ("content", "why"),
    [(b"text", "it is not a recording"), (b"", "it is not a recording")],
)
def test_file_of_another_format_is_refused(file: Path, content: bytes, why: str) -> None:
    """The text names the file."""
    file.write_bytes(content)
    with pytest.raises(DataError, match=f"killed.h5: {why}"):
        repair(file)


def test_damaged_file_is_refused(file: Path) -> None:
    """A superblock whose checksum is wrong is not written again."""
    killed(file, 50)
    content = bytearray(file.read_bytes())
    content[40] ^= 1
    file.write_bytes(content)
    with pytest.raises(DataError, match="the checksum does not fit"):
        repair(file)

    assert file.read_bytes() == bytes(content)
