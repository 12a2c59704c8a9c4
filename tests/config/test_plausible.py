"""Tests of whether a model fits the limits, the commands and the data sheet of its axis."""

import re
from pathlib import Path

import pytest

from piezod.config.daemon import load_daemon
from piezod.config.model_file import dump_model, load_model
from piezod.config.plausible import Span
from piezod.devices import registry
from piezod.errors import ConfigError

CONFIG = Path(__file__).parents[2] / "config"
MODEL = load_model(CONFIG / "models" / "simulated-stack.yaml")
SHEET = "expected_travel_um: 30"


def problem(folder: Path, volts: float = 1.0, microns: float = 1.0, keys: str = "") -> str:
    """Return the problem of the shipped stage with a model of scaled data; empty if it is used.

    Args:
        folder: Folder for the files.
        volts: Factor of the voltages of the data.
        microns: Factor of their positions.
        keys: Further keys of the axis, a line each.
    """
    scaled = {f"drive_{end}_v": volts * getattr(MODEL, f"drive_{end}_v") for end in ("low", "high")}
    for end in ("low", "high"):
        scaled[f"position_{end}_um"] = microns * getattr(MODEL, f"position_{end}_um")
    (folder / "model.yaml").write_text(dump_model(MODEL.model_copy(update=scaled)))
    text = (CONFIG / "simulated.yaml").read_text(encoding="utf-8")
    text = text.replace("models/simulated-stack.yaml", "model.yaml")
    lines = "".join(f"    {line}\n" for line in keys.splitlines())
    text = re.sub(r"    amplifier: rig\n", f"    amplifier: rig\n{lines}", text)
    (folder / "stage.yaml").write_text(text, encoding="utf-8")
    try:
        load_daemon(folder / "stage.yaml", registry)
    except ConfigError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("keys", ["", SHEET, f"{SHEET}\nexpected_volts: 150"])
def test_model_of_the_axis_is_accepted(tmp_path: Path, keys: str) -> None:
    """With a data sheet, too."""
    assert problem(tmp_path, keys=keys) == ""


@pytest.mark.parametrize(
    ("volts", "microns", "keys", "both"),
    [
        (1 / 30, 1.0, "", (" to 4.931 V", "0 to 150 V")),  # a monitor output
        (0.1, 1.0, "", (" to 14.79 V", "0 to 150 V")),
        (0.001, 1.0, "", (" to 0.1479 V", "0 to 150 V")),  # in kV
        (1000.0 / 150.0, 1.0, "", (" to 986.1 V", "0 to 150 V")),
        (1.0, 0.1, "", ("moves over", "0 to 26 µm")),
        (1.0, 0.001, "", ("moves over", "0 to 26 µm")),  # in mm
        (1.0, 1000.0, "", ("moves over", "0 to 26 µm")),  # in nm
        (1.0, 0.5, SHEET, ("nm per V", "30 µm for 150 V")),  # 2 µm per V
        (0.5, 1.0, SHEET, ("nm per V", "30 µm for 150 V")),
        (1.0, 2.0, SHEET, ("nm per V", "30 µm for 150 V")),
    ],
)
def test_model_of_unscaled_data_is_refused_with_both_numbers(
    tmp_path: Path, volts: float, microns: float, keys: str, both: tuple[str, str]
) -> None:
    """The error is at the key `model`, and tells what to do."""
    found = problem(tmp_path, volts, microns, keys)

    assert "model: " in found
    assert all(number in found for number in both)


def test_axis_that_does_not_fit_its_data_sheet_is_refused(tmp_path: Path) -> None:
    """So are volts without a travel."""
    assert "30 µm for 15 V" in problem(tmp_path, keys=f"{SHEET}\nexpected_volts: 15")
    assert "needs expected_travel_um" in problem(tmp_path, keys="expected_volts: 150")


def test_record_of_small_swings_may_have_a_smaller_gain() -> None:
    """The gain of a stage grows with its swing."""
    axis = load_daemon(CONFIG / "simulated.yaml", registry).axes["x"]
    with_sheet = axis.model_copy(update={"expected_travel_um": 30.0, "command_range_um": None})

    assert not list(with_sheet.misfits(Span(40.0, 80.0, 0.5 * 30.0 * 40.0 / 150.0)))
    assert list(with_sheet.misfits(Span(0.0, 150.0, 0.5 * 30.0)))
