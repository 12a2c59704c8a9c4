"""Files of a stage on a full disk: the error names the file, and nothing half written stays."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from piezod.cli.exit_codes import text_of
from piezod.daemon.durable import write_durably
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.lock import Lock
from piezod.daemon.supervisor.marker import Marker
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create

LAYOUT = Layout(("x",), 64, 1_000_000)


@pytest.mark.fault("P6")
@pytest.mark.parametrize(
    ("call", "make", "left"),
    [
        ("pwrite", Lock, True),
        ("write", lambda path: Marker(path).put(), False),
        ("posix_fallocate", lambda path: create(path, LAYOUT), False),
        ("posix_fallocate", lambda path: LastOutputWriter(path, 1), True),
        ("write", lambda path: write_durably(path, b"text"), False),
    ],
    ids=["lock", "marker", "map", "last output", "durable"],
)
def test_error_names_the_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    call: str,
    make: Callable[[Path], object],
    left: bool,
) -> None:
    """A start that fails can be repeated, and its text says what to do."""

    def full(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "file"
    with monkeypatch.context() as patch:
        patch.setattr(os, call, full)
        with pytest.raises(OSError, match="No space left") as raised:
            make(path)

    assert text_of(raised.value) == f"{path}: No space left on device; delete files there"
    assert [each.name for each in tmp_path.iterdir()] == ["file"] * left
    make(path)
