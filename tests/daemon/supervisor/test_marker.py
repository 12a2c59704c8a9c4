"""The mark of a run that did not end in order."""

from pathlib import Path

import pytest

from piezod.daemon.supervisor.marker import Marker


@pytest.mark.fault("P2")
def test_run_that_ended_by_violence_is_noticed(tmp_path: Path) -> None:
    """A mark that nobody removed tells the next run."""
    Marker(tmp_path / "running").put()

    assert Marker(tmp_path / "running").unclean


def test_orderly_end_leaves_no_mark(tmp_path: Path) -> None:
    """Removing it twice does nothing more."""
    marker = Marker(tmp_path / "running")
    marker.put()
    marker.remove()
    marker.remove()

    assert not marker.unclean
    assert not Marker(tmp_path / "running").unclean
