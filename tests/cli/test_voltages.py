"""`piezod voltages`, `piezod export-code`, and `piezod plot` of a model."""

import json
from pathlib import Path

import numpy as np
import pytest

from piezod.inverse.loaded_model import load_model
from piezod.records.csv_file import read_csv, write_csv
from tests.cli.conftest import Command
from tests.control.rig_stage import CONFIG
from tests.control.surface_rig import model_path

MODEL = model_path("stops")


@pytest.fixture
def trajectory(folder: Path) -> Path:
    """Return a file with positions over time."""
    path, t_s = folder / "scan.csv", np.arange(400) / 400.0
    write_csv(path, {"t_s": 5.0 + t_s, "position_um": 12.0 - 8.0 * np.cos(6.0 * t_s)})
    return path


def test_voltages_are_written_as_a_table(piezod: Command, trajectory: Path) -> None:
    """The file has the voltages of the object in Python, and its times begin as given."""
    code, out, _ = piezod("voltages", MODEL, trajectory, "--from-v", 20)
    columns = read_csv(Path("scan-voltages.csv"), ("t_s", "drive_v", "predicted_um"))
    given = read_csv(trajectory, ("t_s", "position_um"))

    assert code == 0
    assert "400 voltages at 400 Hz" in out
    expected_v = load_model(MODEL).voltages(given["t_s"], given["position_um"], from_v=20.0)
    assert np.array_equal(columns["drive_v"], expected_v)
    assert columns["t_s"] == pytest.approx(given["t_s"])


def test_limits_of_a_stage_cut_and_are_told(piezod: Command, trajectory: Path) -> None:
    """With a configuration the limits and the delays of its axis hold."""
    slow = CONFIG.read_text(encoding="utf-8").replace("slew_v_per_s: 20000", "slew_v_per_s: 200")
    models = CONFIG.parent / "models"
    Path("slow.yaml").write_text(slow.replace("models/", f"{models}/"), encoding="utf-8")
    given = ("--config", "slow.yaml", "--axis", "x", "--rate-hz", 200, "--json")
    code, out, _ = piezod("voltages", MODEL, trajectory, "--out", "v.csv", *given)
    document = json.loads(out)

    assert code == 0
    assert document["limited"]["slew rate"] > 0
    assert document["largest_slew_v_per_s"] == pytest.approx(200.0)
    assert "slew rate cuts" in document["warnings"][0]


def test_memory_goes_on_after_earlier_voltages(piezod: Command, trajectory: Path) -> None:
    """A file that the command has written is the past of the next one."""
    piezod("voltages", MODEL, trajectory, "--out", "first.csv")
    code, _, _ = piezod("voltages", MODEL, trajectory, "--out", "next.csv", "--after", "first.csv")
    first, after = (read_csv(Path(name), ("drive_v",)) for name in ("first.csv", "next.csv"))

    assert code == 0
    assert abs(after["drive_v"][0] - first["drive_v"][0]) > 0.1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--axis", "x"), "--axis needs --config"),
        (("--config", CONFIG, "--axis", "q"), "--axis, one of x"),
        (("--out", "v.txt"), ".csv"),
        (("--from-v", 999), "from_v"),
    ],
)
def test_wrong_options_are_refused(
    piezod: Command, trajectory: Path, arguments: tuple[object, ...], text: str
) -> None:
    """The error says what is wrong."""
    code, _, err = piezod("voltages", MODEL, trajectory, *arguments)

    assert code != 0
    assert text in err


@pytest.mark.parametrize(("to", "ending"), [("c", ".c"), ("matlab", ".m")])
def test_code_is_written(piezod: Command, to: str, ending: str) -> None:
    """The file has the name of the model, and so have its functions."""
    code, out, _ = piezod("export-code", MODEL, "--to", to, "--rate-hz", 500)
    text = Path(f"simulated_stack{ending}").read_text(encoding="utf-8")

    assert code == 0
    assert "500 Hz" in out
    assert "simulated_stack" in text
    assert "inverse_" not in text


def test_code_in_another_language_is_refused(piezod: Command) -> None:
    """The ending has to be that of the language."""
    code, _, err = piezod("export-code", MODEL, "--to", "c", "--out", "model.m")

    assert code == 2
    assert ".c" in err


def test_model_is_drawn_with_its_residual(piezod: Command) -> None:
    """`plot` of a model file draws loops, and the residual of a record, in any format."""
    model, t_s = model_path("surface"), np.arange(500) / 500.0
    drive_v = 75.0 - 70.0 * np.cos(12.0 * t_s)
    position_um = load_model(model).positions(t_s, drive_v)
    write_csv(Path("data.csv"), {"t_s": t_s, "drive_v": drive_v, "position_um": position_um})

    for name, record in (("loops.pdf", ()), ("residual.svg", ("--record", "data.csv"))):
        assert piezod("plot", model, "--out", name, *record).code == 0
        assert Path(name).stat().st_size > 1000
    assert piezod("plot", "data.csv", "--record", "data.csv").code == 2
