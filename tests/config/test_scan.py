"""The description of a scan: every mistake is named, all of them at once."""

from pathlib import Path

import pytest

from piezod.config.experiment import load_experiment
from piezod.config.scan import RasterScan, load_scan
from piezod.devices import registry
from piezod.errors import ConfigError

RASTER = """
scan:
  kind: raster
  fast: {axis: x, from_um: 3, to_um: 23, pixels: 64}
  slow: {axis: y, from_um: 3, to_um: 23, pixels: 32}
  lines_per_s: 10
"""
STEPPED = """
scan:
  kind: stack
  planes: {axis: z, from_um: 5, to_um: 10, pixels: 50}
  plane_s: 0.005
  move_s: 0.004
  step: edge
  start: edge
"""
SPIRAL = """
scan:
  kind: spiral
  x: {axis: x, from_um: 5, to_um: 10, pixels: 64}
  y: {axis: z, from_um: 5, to_um: 10, pixels: 40}
  pixel_s: 0.004
  interval_us: 1000
"""
EXAMPLE = Path(__file__).parents[2] / "examples" / "raster.yaml"


def loaded(folder: Path, text: str) -> object:
    """Return the scan of a file with this text."""
    file = folder / "scan.yaml"
    file.write_text(text)
    return load_scan(file)


def test_a_scan_has_defaults(tmp_path: Path) -> None:
    """A snake without pulses."""
    scan = loaded(tmp_path, RASTER)

    assert isinstance(scan, RasterScan)
    assert (scan.sweeps, scan.lines, scan.pulses.highest) == ("snake", 32, 0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "lines_per_s: 10",
            "lines_per_s: 1\n  mode: trimmed\n  pulses: {pixel: 1}",
            ("the name of an output in `lines:`", "the loop scans"),
        ),
        (
            "lines_per_s: 10",
            "lines_per_s: 10\n  pulses: {pixel: shutter}",
            ("must be a number", "without `mode`"),
        ),
        ("lines_per_s: 10", "lines_per_s: 1\n  mode: trimmed\n  start: edge", ("name the line",)),
        ("lines_per_s: 10", "lines_per_s: 10\n  edge: exposed", ("leave it out",)),
        ("lines_per_s: 10", "lines_per_s: 500", ("a pixel lasts 25 µs", "50 µs", "250 lines/s")),
        (
            "lines_per_s: 10",
            "lines_per_s: 200\n  pulses: {pixel: 1}",
            ("two of which make a pulse", "at most 125 lines/s"),
        ),
        ("axis: y", "axis: x", ("fast axis",)),
        ("to_um: 23, pixels: 64", "to_um: 3, pixels: 64", ("must differ from from_um",)),
        ("10\n", "10\n  pulses: {pixel: 2, line: 2}\n", ("line 2 is that of pixel",)),
        ("10\n", "10\n  pulses: {pixel: 9}\n", ("allowed range 1 to 8",)),
        ("kind: raster", "kind: circle", ("raster",)),
        (
            RASTER,
            SPIRAL + "  mode: trimmed\n  pulses: {at: {line: 1, step_um: 1}}\n",
            ("scan.mode: the loop scans lines", "scan.pulses.at: a spiral sweeps no line"),
        ),
        (RASTER, SPIRAL.replace("axis: z", "axis: x"), ("scan.y.axis: is the first axis",)),
        (RASTER, SPIRAL.replace("pixels: 40", "pixels: 41"), ("y.pixels", "allowed: 64")),
        (RASTER, SPIRAL.replace("pixels: 64", "pixels: 1"), ("scan.x.pixels", "at least 2")),
        (RASTER, SPIRAL.replace("0.004", "0.0001"), ("scan.pixel_s", "at least 0.001 s")),
        ("10\n", "10\n  start: edge\n  within_s: 0\n", ("0.01 to 3600 s",)),
        (
            "10\n",
            "10\n  pulses: {at: {line: 1, step_um: 0.1, from_um: 2}}\n",
            ("pulses.at.from_um", "got 2 µm", "3 to 23 µm"),
        ),
        (
            "10\n",
            "10\n  pulses: {at: {line: 1, positions_um: [5, 5.01]}}\n",
            ("pulses.at.positions_um", "0.01 µm apart", "within 40 µs", "150 µs"),
        ),
        (
            "10\n",
            "10\n  pulses: {at: {line: 1, step_um: 0.001}}\n",
            ("pulses.at.step_um", "more than 10000 positions"),
        ),
        ("10\n", "10\n  pulses: {at: {line: 1}}\n", ("either `step_um` or `positions_um`",)),
        (
            "10\n",
            "10\n  passes: 0\n  sweeps: forward\n"
            "  pulses: {at: {line: 1, step_um: 1, way: backward}}\n",
            ("no sweep goes backward", "not learned with `passes: 0`"),
        ),
        (
            "10\n",
            "10\n  pulses: {at: {line: 1, step_um: 1, by: device}}\n",
            ("compares one way",),
        ),
        (
            "10\n",
            "10\n  mode: adaptive\n  pulses: {at: {line: 1, step_um: 1}}\n",
            ("pulses.at", "that a device plays"),
        ),
        (
            "10\n",
            "10\n  pulses: {line: 1, at: {line: 1, step_um: 1}}\n",
            ("line 1 is that of line",),
        ),
        (
            RASTER,
            STEPPED.replace("start: edge", "pulses: {at: {line: 1, step_um: 1}}"),
            ("scan.pulses.at", "a stack holds its planes"),
        ),
        (RASTER, STEPPED, ("scan.start", "the first plane waits for an edge")),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, words: tuple[str, ...]) -> None:
    """With the value, what is allowed, and the remedy."""
    with pytest.raises(ConfigError) as refused:
        loaded(tmp_path, RASTER.replace(old, new))

    assert all(word in str(refused.value) for word in words)


def test_all_mistakes_are_in_one_error(tmp_path: Path) -> None:
    """An axis that the file does not have, a range that is left, and a pixel that is too fast."""
    text = EXAMPLE.read_text().replace(
        "axis: y, from_um: 3, to_um: 23", "axis: q, from_um: 3, to_um: 9"
    )
    file = tmp_path / "wrong.yaml"
    file.write_text(
        text.replace("axis: x, from_um: 3, to_um: 23", "axis: x, from_um: -3, to_um: 29")
    )
    with pytest.raises(ConfigError) as refused:
        load_experiment(file, registry)

    lines = str(refused.value).splitlines()
    assert len(lines) == 3
    assert "no such axis" in str(refused.value)
    assert str(refused.value).count("outside the range of axis x") == 2


def test_a_device_compares_no_calibrated_reading(tmp_path: Path) -> None:
    """Its thresholds are readings; known before anything moves."""
    at = "{line: 1, step_um: 1, way: forward, by: device}"
    text = EXAMPLE.read_text().replace("frame: 3}", f"frame: 3, at: {at.replace('1', '4', 1)}}}")
    file = tmp_path / "compared.yaml"
    file.write_text(text)
    load_experiment(file, registry)
    kind = "calibration: {kind: line, gain: 2}"
    file.write_text(text.replace("beside: [photons]", f"beside: [photons], {kind}", 1))
    with pytest.raises(ConfigError, match="compares its own reading"):
        load_experiment(file, registry)


def test_a_file_without_a_scan_is_refused(tmp_path: Path) -> None:
    """The error names the key."""
    with pytest.raises(ConfigError, match="`scan:`"):
        loaded(tmp_path, "rate_hz: 100\n")


def test_a_scan_takes_the_place_of_cases(tmp_path: Path) -> None:
    """Both together are refused."""
    file = tmp_path / "both.yaml"
    file.write_text(
        EXAMPLE.read_text()
        + "\ncases:\n  - {name: a, period_s: 1, duration_s: 2, command_um: "
        + "{kind: sine, low: 2, high: 8, frequency_hz: 1}}\n"
    )
    with pytest.raises(ConfigError, match="one of them"):
        load_experiment(file, registry)
