"""Stored identities of devices."""

from pathlib import Path

import pytest

from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.devices.interface import Identity

WHO = {"amp": Identity("maker", "stage µ", "1", "1.0"), "fibre": Identity("other", "s", "2", "0")}


def test_stored_identities_come_back(tmp_path: Path) -> None:
    """The newest file counts, and no other file is left."""
    path = tmp_path / "identities.json"
    note_identities(path, {"amp": WHO["fibre"]})
    note_identities(path, WHO)

    assert noted_identities(path) == WHO
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "content", [None, b"", b"\xff", b"[]", b"7", b'{"amp": 7}', b'{"amp": ["a", "b"]}']
)
def test_invalid_file_gives_nothing(tmp_path: Path, content: bytes | None) -> None:
    """A stage must be ramped down without this file too."""
    path = tmp_path / "identities.json"
    if content is not None:
        path.write_bytes(content)

    assert noted_identities(path) == {}
