"""The audit log: kept in any case, and never a reason to refuse a request."""

import errno
import json
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from structlog.testing import capture_logs

from piezod.daemon.stores.audit import KEPT, AuditLog
from piezod.messages.stores import AuditLine

WHEN = datetime(2024, 5, 1, 12, tzinfo=UTC)
STAMP = "2024-05-01T12:00:00.000+00:00"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of a file that does not exist yet."""
    return tmp_path / "state" / "audit.jsonl"


@pytest.fixture
def audit(path: Path) -> Iterator[AuditLog]:
    """Return an audit log with a fixed time of day and files of 2000 bytes."""
    audit = AuditLog(path, lambda: WHEN, 2000)
    yield audit
    audit.close()


def test_entries_come_back_newest_first(audit: AuditLog) -> None:
    """An entry has everything that was written."""
    audit.write(1000, "ann", "cli 12", "goto x 12.5 µm", accepted=True)
    audit.write(1001, "", "", "arm", accepted=False, why="the state is FAULT")

    assert audit.last(10) == (
        AuditLine(STAMP, 1001, "", "", "arm", False, "the state is FAULT"),
        AuditLine(STAMP, 1000, "ann", "cli 12", "goto x 12.5 µm", True),
    )
    assert audit.last(1) == audit.last(10)[:1]
    assert audit.last(0) == ()


def test_entries_of_an_earlier_run_stay(audit: AuditLog, path: Path) -> None:
    """Entries are only appended."""
    audit.write(1000, "ann", "", "arm", accepted=True)
    again = AuditLog(path, lambda: WHEN)
    again.write(1000, "ann", "", "stop", accepted=True)
    again.close()

    assert [entry.what for entry in audit.last(10)] == ["stop", "arm"]


@given(text=st.text(max_size=3000))
def test_an_entry_is_one_line(text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """No text makes a second line, and long texts are cut."""
    path = tmp_path_factory.mktemp("audit") / "audit.jsonl"
    audit = AuditLog(path, lambda: WHEN)
    audit.write(0, text, text, text, accepted=False, why=text)
    audit.close()
    (line,) = path.read_bytes().splitlines()

    assert json.loads(line)["what"] == text[:1000]
    assert audit.last(2) == (
        AuditLine(STAMP, 0, text[:1000], text[:1000], text[:1000], False, text[:1000]),
    )


def test_size_is_bounded(audit: AuditLog, path: Path) -> None:
    """Full files are renamed, the oldest is removed, and the newest entries can be read."""
    for number in range(300):
        audit.write(1000, "ann", "", f"goto {number}", accepted=True)
    files = sorted(each.name for each in path.parent.iterdir())

    assert files == ["audit.jsonl", *(f"audit.jsonl.{number}" for number in range(1, KEPT))]
    assert all(each.stat().st_size <= 2000 for each in path.parent.iterdir())
    assert [entry.what for entry in audit.last(15)] == [f"goto {n}" for n in range(299, 284, -1)]


@pytest.mark.fault("P8")
def test_entry_that_was_cut_off_costs_only_itself(audit: AuditLog, path: Path) -> None:
    """After a power failure the next entry begins a new line."""
    audit.write(1000, "ann", "", "arm", accepted=True)
    with path.open("ab") as file:
        file.write(b'{"when": "2024-')
    again = AuditLog(path, lambda: WHEN)
    again.write(1000, "ann", "", "stop", accepted=True)
    again.sync()
    again.close()

    assert [entry.what for entry in again.last(10)] == ["stop", "arm"]


@pytest.mark.fault("P6")
def test_full_disk_costs_entries_and_no_request(
    audit: AuditLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lost entries are counted, nothing is raised, and later entries are whole."""

    def fail(*_arguments: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    real = os.write
    audit.write(1000, "ann", "", "arm", accepted=True)
    for write in (fail, lambda descriptor, data: real(descriptor, data[:20])):
        with monkeypatch.context() as patch:
            patch.setattr(os, "write", write)
            audit.write(1000, "ann", "", "goto", accepted=True)
    audit.write(1000, "ann", "", "stop", accepted=True)

    assert audit.failed == 2
    assert [entry.what for entry in audit.last(10)] == ["stop", "arm"]


@pytest.mark.fault("P6")
def test_failed_sync_is_logged(audit: AuditLog, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is raised, and the entries can still be read."""

    def fail(_descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    audit.write(1000, "ann", "", "arm", accepted=True)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail)
        with capture_logs() as logs:
            audit.sync()

    assert logs[0]["event"] == "audit not synced"
    assert logs[0]["why"] == "Input/output error"
    assert len(audit.last(10)) == 1


def test_file_is_not_for_everybody(audit: AuditLog, path: Path) -> None:
    """Owner and group may read the file, others may not; links are not followed."""
    audit.write(0, "", "", "", accepted=True)
    link = path.with_name("link.jsonl")
    link.symlink_to(path)
    with pytest.raises(OSError, match="symbolic links"):
        AuditLog(link)

    assert path.stat().st_mode & 0o137 == 0


def test_named_pipe_is_refused(tmp_path: Path) -> None:
    """A start neither waits for a reader of the pipe nor writes into it."""
    path = tmp_path / "audit.jsonl"
    os.mkfifo(path)

    with pytest.raises(OSError, match=r"must be a regular file; remove it: .*audit\.jsonl"):
        AuditLog(path)
