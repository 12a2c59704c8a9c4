"""The mark of a run that did not end in order."""

from pathlib import Path

import pytest

from piezod.daemon.supervisor.marker import Marker


@pytest.mark.fault("P2")
def test_run_that_did_not_end_in_order_is_detected(tmp_path: Path) -> None:
    """A mark that was not removed is found by the next run."""
    Marker(tmp_path / "running").put()

    assert Marker(tmp_path / "running").unclean


@pytest.mark.fault("L3")
def test_loop_that_hung_is_noted_for_the_next_run(tmp_path: Path) -> None:
    """The note is gone with the mark, and with the next run that is started."""
    marker = Marker(tmp_path / "running")
    marker.put()
    marker.note_hung()
    after = Marker(tmp_path / "running")
    after.put()

    assert (marker.hung, after.unclean, after.hung) == (False, True, True)
    assert not Marker(tmp_path / "running").hung
    marker.remove()
    assert not Marker(tmp_path / "running").hung


def test_orderly_end_leaves_no_mark(tmp_path: Path) -> None:
    """Removing the mark twice is no error."""
    marker = Marker(tmp_path / "running")
    marker.put()
    marker.remove()
    marker.remove()

    assert not marker.unclean
    assert not Marker(tmp_path / "running").unclean


def test_link_is_not_followed(tmp_path: Path) -> None:
    """Nothing is written to the target of a link, and the run before counts as not ended."""
    target = tmp_path / "target"
    target.write_text("kept")
    (tmp_path / "running").symlink_to(target)
    marker = Marker(tmp_path / "running")
    marker.note_hung()

    with pytest.raises(OSError, match="symbolic links"):
        marker.put()

    assert (marker.unclean, target.read_text()) == (True, "kept")
