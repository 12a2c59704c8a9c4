"""`piezod play`: its file is checked before anything else."""

from pathlib import Path

from tests.cli.conftest import Command


def test_waveform_that_is_not_periodic_is_refused(piezod: Command, folder: Path) -> None:
    """The message names the file, the key and the waveforms that a table can have."""
    (folder / "wave.yaml").write_text("command_um: {kind: reversals, low: 0, high: 1}\n")
    outcome = piezod("play", "wave.yaml")

    assert outcome.code == 78
    assert "wave.yaml" in outcome.err
    assert "command_um" in outcome.err
