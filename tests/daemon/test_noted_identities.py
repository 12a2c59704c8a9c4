"""Who each device was, on record."""

from pathlib import Path

import pytest

from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.devices.interface import Identity

WHO = {"amp": Identity("maker", "stage µ", "1", "1.0"), "fibre": Identity("other", "s", "2", "0")}


def test_what_is_noted_is_what_is_read(tmp_path: Path) -> None:
    """The newest note counts, and nothing else is left behind."""
    path = tmp_path / "identities.json"
    note_identities(path, {"amp": WHO["fibre"]})
    note_identities(path, WHO)

    assert noted_identities(path) == WHO
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "content", [None, b"", b"\xff", b"[]", b"7", b'{"amp": 7}', b'{"amp": ["a", "b"]}']
)
def test_a_file_that_is_none_tells_nobody(tmp_path: Path, content: bytes | None) -> None:
    """A stage must come down without it, too."""
    path = tmp_path / "identities.json"
    if content is not None:
        path.write_bytes(content)

    assert noted_identities(path) == {}
