import os
from pathlib import Path

import pytest

from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import MapError, SharedMap, attach, create
from piezod.telemetry.words import Word

LAYOUT = Layout(("x",), 64, 1_000_000)


def test_both_sides_share_one_memory(shared: SharedMap) -> None:
    """Both sides map the same memory, which contains the layout."""
    other = attach(shared.path)

    shared.words[Word.HEALTHY_CYCLES] = 42

    assert other.words[Word.HEALTHY_CYCLES] == 42
    assert other.layout == shared.layout


def test_reader_cannot_write(shared: SharedMap) -> None:
    """A reader maps the memory read-only."""
    other = attach(shared.path)

    with pytest.raises(TypeError, match="read-only"):
        other.words[Word.LOOP_PID] = 1


def test_file_is_private(shared: SharedMap) -> None:
    """Only its owner may read it, for any umask."""
    assert shared.path.stat().st_mode & 0o777 == 0o600


def test_file_of_an_earlier_run_is_replaced(tmp_path: Path) -> None:
    """A reader of the old file keeps its memory; the new one starts at zero."""
    path = tmp_path / "loop.map"
    before = create(path, LAYOUT)
    before.words[Word.LOOP_PID] = 7

    after = create(path, LAYOUT)

    assert after.words[Word.LOOP_PID] == 0
    assert before.words[Word.LOOP_PID] == 7


@pytest.mark.parametrize("content", [b"", b"short", bytes(4096), b"piezodLM" + bytes(100)])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    """An incomplete file, or another one, is refused."""
    path = tmp_path / "loop.map"
    path.write_bytes(content)

    with pytest.raises(MapError, match=r"loop\.map is not a shared memory of this version"):
        attach(path)


def test_file_cut_short_is_refused(shared: SharedMap) -> None:
    """Its use would end in a bus error."""
    os.truncate(shared.path, shared.layout.size - 4096)

    with pytest.raises(MapError):
        attach(shared.path)


def test_absent_file_raises_file_not_found(tmp_path: Path) -> None:
    """The caller decides whether it means that no daemon runs."""
    with pytest.raises(FileNotFoundError):
        attach(tmp_path / "loop.map")


def test_report_is_published_once_and_complete(shared: SharedMap) -> None:
    """Before it is published there is none."""
    other = attach(shared.path)
    assert other.report() is None

    shared.set_report([{"name": "memory", "ok": True}])

    assert other.report() == [{"name": "memory", "ok": True}]


def test_no_word_lies_beyond_the_part(shared: SharedMap) -> None:
    """Every word has a place of its own in the part."""
    assert len(set(Word)) == len(Word.__members__)
    assert max(Word) < len(shared.words)
