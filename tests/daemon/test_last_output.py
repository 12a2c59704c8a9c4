import subprocess
import sys
from math import isnan, nan
from pathlib import Path

import pytest

from piezod.daemon.last_output import LastOutputReader, LastOutputWriter

WORDS_PER_AXIS = 4


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of the file."""
    return tmp_path / "output.map"


def test_newest_voltages_are_read_back(path: Path) -> None:
    """The file has the newest voltage of every axis, with its instant."""
    writer = LastOutputWriter(path, 2)
    writer.note([1.0, 2.0], 10)
    writer.note([1.5, 2.5], 20)

    assert LastOutputReader(path).read() == [(1.5, 20), (2.5, 20)]


def test_voltage_of_an_axis_that_is_not_written_stays(path: Path) -> None:
    """NaN stands for an axis that waits for its output while others are written."""
    writer = LastOutputWriter(path, 2)
    writer.note([1.0, 2.0], 10)
    writer.note([nan, 2.5], 20)

    assert LastOutputReader(path).read() == [(1.0, 10), (2.5, 20)]


def test_nothing_is_known_before_the_first_write(path: Path) -> None:
    """Before the first write every voltage is NaN."""
    LastOutputWriter(path, 2)

    assert all(isnan(output.drive_v) for output in LastOutputReader(path).read())
    assert len(LastOutputReader(path).read()) == 2


def test_voltages_outlive_the_next_start(path: Path) -> None:
    """A loop that dies before its first write keeps the voltages."""
    LastOutputWriter(path, 1).note([42.0], 10)

    LastOutputWriter(path, 1)

    assert LastOutputReader(path).read() == [(42.0, 10)]


def test_file_for_another_number_of_axes_is_made_anew(path: Path) -> None:
    """The old voltages belong to unknown axes."""
    LastOutputWriter(path, 1).note([42.0], 10)

    LastOutputWriter(path, 3)

    assert [isnan(output.drive_v) for output in LastOutputReader(path).read()] == [True] * 3


def test_half_written_voltage_is_unknown(path: Path) -> None:
    """A voltage that the writer did not complete is NaN; the other axes stay."""
    LastOutputWriter(path, 2).note([1.0, 2.0], 10)
    content = bytearray(path.read_bytes())
    words = memoryview(content).cast("q")
    words[1] += 1
    path.write_bytes(content)

    first, second = LastOutputReader(path).read()

    assert isnan(first.drive_v)
    assert second == (2.0, 10)


@pytest.mark.parametrize("content", [b"", b"1", bytes(7), bytes(16), b"\x02" + bytes(39)])
def test_invalid_file_gives_nothing(path: Path, content: bytes) -> None:
    """A truncated or foreign file has no voltages."""
    path.write_bytes(content)

    assert LastOutputReader(path).read() == []


def test_absent_file_gives_nothing(path: Path) -> None:
    """A missing file has no voltages."""
    assert LastOutputReader(path).read() == []


def test_file_is_private(path: Path) -> None:
    """Only its owner may read the file."""
    LastOutputWriter(path, 1)

    assert path.stat().st_mode & 0o777 == 0o600


def test_reading_needs_the_standard_library_only() -> None:
    """`piezod safe` must not depend on anything that may be broken."""
    code = "import sys; import piezod.daemon.last_output; print(*sys.modules)"

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    ours = {name for name in done.stdout.split() if name.startswith("piezod.")}
    assert ours == {"piezod.daemon", "piezod.daemon.last_output"}
    assert not {"numpy", "numba", "pydantic"} & set(done.stdout.split())


def test_forgotten_voltages_are_unknown(path: Path) -> None:
    """After `forget` every voltage is NaN until the next write."""
    writer = LastOutputWriter(path, 2)
    writer.note([60.0, 70.0], 1)
    writer.forget(2)

    assert [isnan(each.drive_v) for each in LastOutputReader(path).read()] == [True, True]
