"""A scan in virtual time: learned, stored, with a picture that shows the pattern."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.scan import AnyScan, LineScan, RasterScan, SpanConfig, StackScan
from piezod.devices import registry
from piezod.errors import DataError
from piezod.experiment.play.learn import STORED
from piezod.experiment.scan.learn import FrameReport
from piezod.experiment.scan.run import ScanResult, ScanSetting, Told
from piezod.experiment.virtual.scan import scan_virtually
from piezod.records.new_name import free_name
from piezod.records.scan_file import read_scan
from piezod_drivers.simulated.pattern import counts_at

TEXT = """
rate_hz: 200
devices:
  rig:
    driver: simulated
    options:
      sub_step_us: 50
      sensor: {antialias_hz: 5000, bandwidth_hz: 10000, delay_s: 0.00011}
axes:
AXES
settle_s: 0.2
scan:
  kind: raster
  fast: {axis: x, from_um: 6, to_um: 18, pixels: 24}
  slow: {axis: y, from_um: 6, to_um: 18, pixels: 12}
  lines_per_s: 20
  passes: 2
  pulses: {pixel: 1, line: 2, frame: 3}
"""
AXIS = """  NAME:
    amplifier: rig
    sensor: {device: rig, beside: [photons]}
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    command_range_um: [0, 26]
    model: MODEL
    compensator: {sensor_delay_s: 0.000171}
"""
MODEL = Path(__file__).parents[3] / "config" / "models" / "simulated-stack.yaml"


def config(folder: Path) -> ExperimentConfig:
    """Return the experiment."""
    axes = "".join(AXIS.replace("NAME", name).replace("MODEL", str(MODEL)) for name in ("x", "y"))
    file = folder / "scan.yaml"
    file.write_text(TEXT.replace("AXES", axes))
    return load_experiment(file, registry)


def scanned(
    folder: Path, scan: AnyScan | None = None, tables: Path | None = None
) -> tuple[ScanResult, list[FrameReport], list[str]]:
    """Run it; return the result, the frames, and what was noted."""
    frames, notes = list[FrameReport](), list[str]()
    told = Told(lambda _: None, frames.append, lambda *_: None, notes.append)
    given = config(folder)
    assert given.scan is not None
    setting = ScanSetting(free_name(folder / "scan.nxs"), "text", tables)
    return scan_virtually(given, scan or given.scan, setting, told), frames, notes


def test_frames_are_learned_and_the_last_one_is_stored(tmp_path: Path) -> None:
    """The true errors fall, each pixel has its pulse, and the picture is that of the pattern."""
    result, frames, notes = scanned(tmp_path)
    stored = read_scan(result.file)
    (y_um, x_um) = (values for _, values in stored.scales)
    grid = np.stack(np.meshgrid(x_um, y_um), axis=-1).reshape(-1, 2)
    pattern = counts_at(grid).reshape(12, 24)

    assert [each.label for each in frames] == ["frame 1", "frame 2", "stored"]
    assert frames[-1].true.slow_rms < 0.3 * frames[0].true.slow_rms
    assert frames[-1].true.fast_max < 0.2
    assert np.corrcoef(stored.pictures["photons"].ravel(), pattern.ravel())[0, 1] > 0.7
    assert notes == [f"pulses of the device, in all frames: {3 * 24 * 12}, {3 * 12}, 3"]
    with h5py.File(result.file) as file:
        assert file["scan/configuration"][()] == b"text"


def test_a_learned_line_is_stored_and_used_again(tmp_path: Path) -> None:
    """With the same conditions a later scan begins with it; otherwise it says what has changed."""
    span = SpanConfig(axis="x", from_um=6.0, to_um=18.0, pixels=24)
    scan = LineScan(fast=span, repeats=4, lines_per_s=20.0, passes=1)
    first, _, notes = scanned(tmp_path, scan, tmp_path)
    again, _, then = scanned(tmp_path, scan, tmp_path)
    _, _, other = scanned(tmp_path, scan.model_copy(update={"turn_share": 0.25}), tmp_path)
    name = "table_x_line-6-to-18-um-20-per-s.yaml"

    assert notes == [f"no table of this waveform in {tmp_path}", f"stored as {name}"]
    assert then[0].startswith(f"begins with {name}")
    assert other[0] == f"{name} is not used, changed since: another waveform"
    assert first.line is not None
    assert again.line is not None
    assert again.line.reports[0].label == STORED
    assert again.line.reports[0].measured.max_pct < 0.5 * first.line.reports[0].measured.max_pct


def test_a_stack_pulses_once_in_each_plane(tmp_path: Path) -> None:
    """Fifty planes, a hundred a second, none lost."""
    scan = StackScan.model_validate(
        {
            "planes": SpanConfig(axis="y", from_um=8.0, to_um=13.0, pixels=50),
            "plane_s": 0.006,
            "move_s": 0.004,
            "passes": 3,
            "pulses": {"pixel": 1},
        }
    )
    result, frames, notes = scanned(tmp_path, scan)

    assert result.plan.duration_s == pytest.approx(0.5)
    assert notes == [f"pulses of the device, in all frames: {4 * 50}"]
    assert frames[-1].true.slow_max < 0.5
    assert read_scan(result.file).pictures["photons"].shape == (50,)


def test_a_scan_that_does_not_fit_the_model_stores_nothing(tmp_path: Path) -> None:
    """It is refused before a table is played."""
    scan = config(tmp_path).scan
    assert isinstance(scan, RasterScan)
    wide = scan.model_copy(
        update={"fast": SpanConfig(axis="x", from_um=1.0, to_um=25.9, pixels=24)}
    )
    with pytest.raises(DataError, match="with its turns"):
        scanned(tmp_path, wide)

    assert not (tmp_path / "scan.nxs").exists()
