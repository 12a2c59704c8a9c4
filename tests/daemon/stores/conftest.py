"""What tests of recordings share."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from piezod.daemon.stores.recorder import Recorder
from tests.daemon.fake_ring import FakeRing


@pytest.fixture
def recorder(ring: FakeRing, tmp_path: Path) -> Iterator[Recorder]:
    """Return a recorder, which is stopped at the end."""
    recorder = Recorder(ring.stage, tmp_path / "recordings", lambda _folder: "")
    yield recorder
    recorder.stop()
