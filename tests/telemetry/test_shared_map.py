import os
from pathlib import Path

import pytest

from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import MapError, SharedMap, attach, create
from piezod.telemetry.words import Word

LAYOUT = Layout(("x",), 64, 1_000_000)


def test_what_one_side_writes_the_other_reads(shared: SharedMap) -> None:
    """Both map the same memory, and the layout travels in it."""
    other = attach(shared.path)

    shared.words[Word.HEALTHY_CYCLES] = 42

    assert other.words[Word.HEALTHY_CYCLES] == 42
    assert other.layout == shared.layout


def test_reader_cannot_write(shared: SharedMap) -> None:
    """Whoever attaches to look gets memory that is read-only."""
    other = attach(shared.path)

    with pytest.raises(TypeError, match="read-only"):
        other.words[Word.LOOP_PID] = 1


def test_file_is_private(shared: SharedMap) -> None:
    """Only its owner may read it, whatever the mask of the process."""
    assert shared.path.stat().st_mode & 0o777 == 0o600


def test_file_of_an_earlier_run_is_replaced(tmp_path: Path) -> None:
    """A reader of the old one keeps what it has; the new one begins at zero."""
    path = tmp_path / "loop.map"
    before = create(path, LAYOUT)
    before.words[Word.LOOP_PID] = 7

    after = create(path, LAYOUT)

    assert after.words[Word.LOOP_PID] == 0
    assert before.words[Word.LOOP_PID] == 7


@pytest.mark.parametrize("content", [b"", b"short", bytes(4096), b"piezodLM" + bytes(100)])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    """A file that is not complete, or something else, is no shared memory."""
    path = tmp_path / "loop.map"
    path.write_bytes(content)

    with pytest.raises(MapError, match=r"loop\.map is no shared memory of this version"):
        attach(path)


def test_file_cut_short_is_refused(shared: SharedMap) -> None:
    """To use one would end in a bus error."""
    os.truncate(shared.path, shared.layout.size - 4096)

    with pytest.raises(MapError):
        attach(shared.path)


def test_absent_file_is_an_error_of_the_system(tmp_path: Path) -> None:
    """The caller knows whether that means that nothing runs."""
    with pytest.raises(FileNotFoundError):
        attach(tmp_path / "loop.map")


def test_report_travels(shared: SharedMap) -> None:
    """Nothing before it is there, then all of it."""
    other = attach(shared.path)
    assert other.report() is None

    shared.set_report([{"name": "memory", "ok": True}])

    assert other.report() == [{"name": "memory", "ok": True}]


def test_no_word_lies_beyond_the_part(shared: SharedMap) -> None:
    """There is room for every word, each in a place of its own."""
    assert len(set(Word)) == len(Word.__members__)
    assert max(Word) < len(shared.words)
