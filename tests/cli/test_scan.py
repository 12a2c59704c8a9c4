"""`piezod scan`, and what the other commands say of its files."""

import json
from pathlib import Path

import pytest

from piezod.records.scan_file import is_scan
from tests.cli.conftest import Command
from tests.experiment.scan.test_run import config
from tests.records.test_scan_file import new_file, sweep

RASTER = Path(__file__).parents[2] / "examples" / "raster.yaml"


def test_a_line_is_scanned_and_drawn(
    piezod: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In virtual time; a second scan gets a number, and `plot` finds the picture."""
    config(folder)  # writes scan.yaml
    file = folder / "scan.yaml"
    head, _, _ = file.read_text().partition("scan:\n")
    line = "{axis: x, from_um: 6, to_um: 18, pixels: 16}"
    file.write_text(
        f"{head}scan: {{kind: line, fast: {line}, repeats: 4, lines_per_s: 20, passes: 0}}\n"
    )
    (folder / "scan.nxs").write_text("older")
    code, out, _ = piezod("scan", file, "--json")
    document = json.loads(out)
    with capsys.disabled():
        plotted = piezod("plot", "scan-2.nxs")

    assert (code, plotted.code) == (0, 0)
    assert (document["file"], document["sweeps"], document["pixels"]) == ("scan-2.nxs", 4, 16)
    assert is_scan(folder / "scan-2.nxs")
    assert (folder / "scan-2.png").stat().st_size > 1000
    assert (folder / "scan.nxs").read_text() == "older"


def test_the_picture_of_a_scan_in_progress_is_drawn(piezod: Command, folder: Path) -> None:
    """Rows that were not swept yet stay empty."""
    with new_file(folder / "now.nxs") as file:
        file.append(sweep(0))
        code, out, err = piezod("plot", "now.nxs")

    assert (code, out, err) == (0, "Figure: now.png\n", "")


def test_other_commands_know_a_scan(piezod: Command) -> None:
    """`check` describes it, and `experiment` names the command that runs it."""
    checked, run = piezod("check", RASTER), piezod("experiment", RASTER)

    assert "ok, an experiment: a raster scanned on 2 axes" in checked.out.replace("\n", " ")
    assert run.code == 2
    assert "`piezod scan`" in run.err


def test_the_loop_needs_no_table(piezod: Command, folder: Path) -> None:
    """Its scans learn no line that `--tables` could store."""
    config(folder)
    file = folder / "scan.yaml"
    file.write_text(file.read_text().partition("  pulses:")[0] + "  mode: trimmed\n")

    assert "only without `mode`" in piezod("scan", file, "--tables", folder).err


def test_options_of_a_running_stage_need_one(piezod: Command) -> None:
    """And its seed is its own."""
    assert "--live" in piezod("scan", RASTER, "--stage", "bench").err
    assert "--seed" in piezod("scan", RASTER, "--live", "--seed", "3").err
