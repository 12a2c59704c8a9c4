"""Whether the configuration file is still the one in force."""

import os
from pathlib import Path

import pytest

from piezod.daemon.supervisor.source_file import SourceFile


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a configuration file."""
    path = tmp_path / "stage.yaml"
    path.write_text("rate_hz: 100", encoding="utf-8")
    return path


@pytest.mark.fault("P11")
def test_other_contents_are_a_change_until_they_are_taken_back(path: Path) -> None:
    """The same length does not hide it."""
    file = SourceFile(path)
    before = file.changed()
    path.write_text("rate_hz: 200", encoding="utf-8")
    os.utime(path, ns=(1, 1))
    edited = [file.changed(), file.changed()]
    path.write_text("rate_hz: 100", encoding="utf-8")

    assert (before, edited, file.changed()) == (False, [True, True], False)


@pytest.mark.fault("P11")
def test_touched_file_is_no_change(path: Path) -> None:
    """Only the contents count."""
    file = SourceFile(path)
    os.utime(path, ns=(1, 1))

    assert not file.changed()


@pytest.mark.fault("P11")
def test_file_that_is_gone_or_no_file_is_a_change(path: Path) -> None:
    """A pipe is not opened: it would wait for a writer."""
    file = SourceFile(path)
    path.unlink()
    gone = file.changed()
    os.mkfifo(path)

    assert (gone, file.changed()) == (True, True)
