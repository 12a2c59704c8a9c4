import subprocess
import sys
from math import isnan
from pathlib import Path

import pytest

from piezod.daemon.last_output import LastOutputWriter, read_last_output

WORDS_PER_AXIS = 4


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return where the file is."""
    return tmp_path / "output.map"


def test_newest_voltages_are_read_back(path: Path) -> None:
    """Of all axes, with the instant, as long as the file is there."""
    writer = LastOutputWriter(path, 2)
    writer.note([1.0, 2.0], 10)
    writer.note([1.5, 2.5], 20)

    assert read_last_output(path) == [(1.5, 20), (2.5, 20)]


def test_nothing_is_known_before_the_first_write(path: Path) -> None:
    """No voltage is told that nobody has written."""
    LastOutputWriter(path, 2)

    assert all(isnan(output.drive_v) for output in read_last_output(path))
    assert len(read_last_output(path)) == 2


def test_voltages_outlive_the_next_start(path: Path) -> None:
    """A loop that starts and dies before it writes does not take them away."""
    LastOutputWriter(path, 1).note([42.0], 10)

    LastOutputWriter(path, 1)

    assert read_last_output(path) == [(42.0, 10)]


def test_file_for_another_number_of_axes_is_made_anew(path: Path) -> None:
    """Its voltages belong to axes that nobody can name."""
    LastOutputWriter(path, 1).note([42.0], 10)

    LastOutputWriter(path, 3)

    assert [isnan(output.drive_v) for output in read_last_output(path)] == [True] * 3


def test_half_written_voltage_is_not_told(path: Path) -> None:
    """A writer that died within a note leaves the voltage unknown, those of other axes stay."""
    LastOutputWriter(path, 2).note([1.0, 2.0], 10)
    content = bytearray(path.read_bytes())
    words = memoryview(content).cast("q")
    words[1] += 1
    path.write_bytes(content)

    first, second = read_last_output(path)

    assert isnan(first.drive_v)
    assert second == (2.0, 10)


@pytest.mark.parametrize("content", [b"", b"1", bytes(7), bytes(16), b"\x02" + bytes(39)])
def test_file_that_makes_no_sense_tells_nothing(path: Path, content: bytes) -> None:
    """Cut short, or of another making."""
    path.write_bytes(content)

    assert read_last_output(path) == []


def test_absent_file_tells_nothing(path: Path) -> None:
    """Nobody has written there yet."""
    assert read_last_output(path) == []


def test_file_is_private(path: Path) -> None:
    """Only its owner can say which voltage was written."""
    LastOutputWriter(path, 1)

    assert path.stat().st_mode & 0o777 == 0o600


def test_reading_needs_the_standard_library_only() -> None:
    """What ramps the stage down when all else is broken must not need more."""
    code = "import sys; import piezod.daemon.last_output; print(*sys.modules)"

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    ours = {name for name in done.stdout.split() if name.startswith("piezod.")}
    assert ours == {"piezod.daemon", "piezod.daemon.last_output"}
    assert not {"numpy", "numba", "pydantic"} & set(done.stdout.split())


def test_what_is_forgotten_is_not_known(path: Path) -> None:
    """Of no axis, until it is written again."""
    writer = LastOutputWriter(path, 2)
    writer.note([60.0, 70.0], 1)
    writer.forget(2)

    assert [isnan(each.drive_v) for each in read_last_output(path)] == [True, True]
