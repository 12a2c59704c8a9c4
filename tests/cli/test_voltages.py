"""`piezod voltages`, `piezod export-code`, and `piezod plot` of a model."""

import json
from pathlib import Path

import numpy as np
import pytest

from piezod.hysteresis.memory import FloatArray
from piezod.inverse.loaded_model import load_model
from piezod.records.csv_file import write_csv
from tests.cli.conftest import Command
from tests.control.rig_stage import CONFIG
from tests.control.surface_rig import model_path

MODEL = model_path("stops")


def column(path: Path, name: str) -> FloatArray:
    """Return a column of a CSV file."""
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    return np.asarray(table[name], dtype=np.float64)


@pytest.fixture
def trajectory(folder: Path) -> Path:
    """Return a file with positions over time."""
    path, t_s = folder / "scan.csv", np.arange(400) / 400.0
    write_csv(path, {"t_s": 5.0 + t_s, "position_um": 12.0 - 8.0 * np.cos(6.0 * t_s)})
    return path


def test_voltages_are_written_as_a_table(piezod: Command, trajectory: Path) -> None:
    """The file has the voltages of the object in Python, and its times begin as given."""
    code, out, _ = piezod("voltages", MODEL, trajectory, "--from-v", 20)
    t_s, position_um = column(trajectory, "t_s"), column(trajectory, "position_um")

    assert code == 0
    assert "400 voltages at 400 Hz" in out
    expected_v = load_model(MODEL).voltages(t_s, position_um, from_v=20.0)
    assert np.array_equal(column(Path("scan-voltages.csv"), "drive_v"), expected_v)
    assert column(Path("scan-voltages.csv"), "t_s") == pytest.approx(t_s)


def test_trajectory_of_another_format_is_read(piezod: Command, trajectory: Path) -> None:
    """Columns in other units, and without time, are taken as the options say."""
    position_um = column(trajectory, "position_um")
    np.save("scan.npy", position_um * 1e3)
    given = ("--columns", "position=1", "--scale", "position=0.001", "--rate-hz", 400)
    piezod("voltages", MODEL, trajectory)
    code, out, err = piezod("voltages", MODEL, "scan.npy", "--out", "same.csv", *given)

    assert code == 0, out + err
    same_v = column(Path("same.csv"), "drive_v")
    assert same_v == pytest.approx(column(Path("scan-voltages.csv"), "drive_v"))


def test_limits_of_a_stage_cut_and_are_told(piezod: Command, trajectory: Path) -> None:
    """With a configuration the limits and the delays of its axis hold."""
    slow = CONFIG.read_text(encoding="utf-8").replace("slew_v_per_s: 20000", "slew_v_per_s: 200")
    models = CONFIG.parent / "models"
    Path("slow.yaml").write_text(slow.replace("models/", f"{models}/"), encoding="utf-8")
    given = ("--config", "slow.yaml", "--axis", "x", "--loop-hz", 200, "--json")
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
    first_v, after_v = (column(Path(name), "drive_v") for name in ("first.csv", "next.csv"))

    assert code == 0
    assert abs(after_v[0] - first_v[0]) > 0.1


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
    code, out, _ = piezod("export-code", MODEL, "--to", to, "--loop-hz", 500)
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
