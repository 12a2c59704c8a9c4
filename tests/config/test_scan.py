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
        ("kind: raster", "kind: spiral", ("raster",)),
        ("10\n", "10\n  start: edge\n  within_s: 0\n", ("0.01 to 3600 s",)),
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
