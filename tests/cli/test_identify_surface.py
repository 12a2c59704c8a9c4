"""`piezod identify --method surface`."""

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from piezod.config.model_file import load_model
from piezod.control.law.model_files import read_model
from piezod.experiment.fit.record import Record
from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.path_relaxation import PathRelaxation
from tests.cli.conftest import Command
from tests.experiment.fit.made_up_ringing import ringing_record
from tests.experiment.made_up import write_record
from tests.experiment.made_up_surface import surface_record

SURFACE = ("--method", "surface")


@pytest.fixture
def data(folder: Path) -> Path:
    """Return a data file of a stage that is a surface, whose samples are reported too early."""
    record = surface_record(delay_s=-0.004, creep=0.004, noise=0.0005, duration_s=20.0)
    write_record(folder / "data.csv", record)
    return Path("data.csv")


@pytest.mark.usefixtures("fitted_once")
def test_model_file_of_a_surface(piezod: Command, data: Path, folder: Path) -> None:
    """The file has the errors of voltage and position; `check` and a stage accept it."""
    options = (*SURFACE, "--test", data, "--out", "model.yaml")

    document = json.loads(piezod("identify", "--verbose", data, *options, "--json").out)

    file = load_model(folder / "model.yaml")
    assert file.is_surface
    assert file.fit.model_dump() == document["train"]
    assert isinstance(read_model(folder / "model.yaml")[0].form, SurfaceForm)
    assert piezod("check", "model.yaml").out == "model.yaml: ok, a model: a surface, by surface\n"
    assert (folder / "model.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.stress
@pytest.mark.usefixtures("fitted_once")
def test_lag_with_the_rate_is_shown(piezod: Command, folder: Path) -> None:
    """A stage whose loops widen with the rate has its lag in the text and in the document."""
    record = surface_record(activation=0.01, noise=0.0005, duration_s=20.0)
    write_record(folder / "data.csv", record)

    text = piezod("identify", "--verbose", "data.csv", *SURFACE).out
    document = json.loads(piezod("identify", "--verbose", "data.csv", *SURFACE, "--json").out)

    assert document["rate_lag"] == pytest.approx(0.01, rel=0.1)
    shown = f"lag {100 * document['rate_lag']:.2g} % of the drive's range per e-fold of its rate"
    assert shown in " ".join(text.split())


@pytest.mark.stress
@pytest.mark.usefixtures("fitted_once")
def test_relaxation_along_the_path_is_shown_and_kept(piezod: Command, folder: Path) -> None:
    """A stage whose loops do not close has it in the text, in the document and in the file."""
    path = PathRelaxation(-0.2, 2.0, 0.1)
    record = surface_record(path=path, creep=0.004, noise=0.0005, duration_s=20.0)
    write_record(folder / "data.csv", record)

    text = piezod("identify", "--verbose", "data.csv", *SURFACE, "--out", "model.yaml").out
    document = json.loads(piezod("identify", "--verbose", "data.csv", *SURFACE, "--json").out)

    found = document["path_relaxation"]
    assert found["decay"] == pytest.approx(2.0, rel=0.1)
    shown = f"a part relaxes over {100 / found['decay']:.2g} % of the drive's range, up or down"
    assert shown in " ".join(text.split())
    form = read_model(folder / "model.yaml")[0].form
    assert isinstance(form, SurfaceForm)
    assert form.path == PathRelaxation(**found)


@pytest.mark.usefixtures("fitted_once")
def test_document_of_a_surface(piezod: Command, data: Path) -> None:
    """It has both errors everywhere, the uncertainty, the parts and a negative delay."""
    document = json.loads(
        piezod("identify", "--verbose", data, *SURFACE, "--test", data, "--json").out
    )

    assert (document["order"], document["thresholds"], document["creep"]) == (None, None, True)
    assert document["delay_s"] == pytest.approx(-0.004, abs=5e-4)
    curve = document["delay_estimate"]["criterion"]["position_error_rms_pct"]
    assert min(curve) == pytest.approx(curve[len(curve) // 2], rel=0.01)
    errors = [document[key] for key in ("train", "test", "test_offset_removed")]
    for each in (*errors, document["cross_validation"], *document["cross_validation"]["blocks"]):
        assert 0.0 < each["position_error_rms_pct"] < 0.1
        assert 0.0 < each["voltage_error_rms_pct"] < 0.2
    assert abs(document["test_offset_removed"]["position_offset_um"]) < 0.01
    assert 0.0 < document["uncertainty"]["voltage_band_95"]["rms_pct"] < 0.2
    parts = document["position_residual"]
    assert parts["noise_pct"] == pytest.approx(0.05, rel=0.2)
    squares = [
        parts[f"{name}_pct"] ** 2 for name in ("drift", "rate", "vibration", "noise", "rest")
    ]
    assert sum(squares) == pytest.approx(parts["total_pct"] ** 2, rel=0.1)
    assert document["without_creep"]["train"]["position_error_rms_pct"] > 0.1


@pytest.mark.usefixtures("fitted_once")
def test_text_of_a_surface(piezod: Command, data: Path) -> None:
    """It says which errors are which, and what a negative delay means."""
    code, out, err = piezod("identify", "--verbose", data, *SURFACE, "--test", data)

    assert (code, err) == (0, "")
    text = " ".join(out.split())
    assert "from the smallest rms error of the predicted position" in text
    assert "It is negative: the position leads the recorded voltage" in text
    assert "Model by surface, a smooth surface of loops, with creep. Error of the drive" in text
    assert "Error of the position predicted from the drive voltage, in % of its range:" in text
    assert "Residual of the position as recorded, without its mean: 0.05" in text


def test_given_delay_may_be_negative(piezod: Command, folder: Path) -> None:
    """A surface takes the delay of samples that were reported early, and stores it."""
    data = folder / "data.csv"
    write_record(data, surface_record(delay_s=-0.004, noise=0.0005, duration_s=8.0))
    options = ("--delay-s", -0.004, "--out", "model.yaml")

    code, out, err = piezod("identify", "--verbose", data, *SURFACE, *options)

    assert (code, err) == (0, "")
    assert "Delay -4 ms, as given." in out
    assert load_model(folder / "model.yaml").delay_s == -0.004
    assert (
        "Delay 0 ms, as given."
        in piezod("identify", "--verbose", data, *SURFACE, "--delay-s", 0).out
    )


@pytest.mark.parametrize("method", [(), ("--method", "lms"), ("--order", 3)])
def test_negative_delay_of_stops_is_refused(
    piezod: Command, data: Path, method: tuple[str, ...]
) -> None:
    """Every method that may take stops refuses a negative delay, with the reason and a remedy."""
    code, out, err = piezod("identify", "--verbose", data, *method, "--delay-s", -0.004)

    assert (code, out) == (2, "")
    assert (
        "'--delay-s': must be auto, or a time from 0 to 1 s (got -0.004); stop operators have no "
        "negative delay, and --method auto tries them: give --method surface, which takes -0.1 s "
        "or more"
    ) in err


@pytest.mark.parametrize("delay", ["-0.2", "2", "nan", "soon"])
def test_delay_that_no_file_holds_is_refused(piezod: Command, data: Path, delay: str) -> None:
    """The range of a surface is that of its model file."""
    code, _, err = piezod("identify", "--verbose", data, *SURFACE, "--delay-s", delay)

    assert code == 2
    assert f"'--delay-s': must be auto, or a time from -0.1 to 1 s (got {delay})" in err


@pytest.mark.parametrize(
    ("record", "text"),
    [
        pytest.param(
            partial(ringing_record, duration_s=1.0),
            r"Taken: surface(?!.* it has no first mode)",
            marks=pytest.mark.stress,
        ),
        (
            partial(surface_record, noise=0.0005, duration_s=15.0),
            r"it has no first mode, because the record shows none that makes its errors on "
            r"held-out blocks smaller by 10 % or more\.",
        ),
    ],
    ids=["ringing", "slow"],
)
def test_choice_tells_whether_the_model_has_the_first_mode(
    piezod: Command, folder: Path, record: Callable[[], Record], text: str
) -> None:
    """A record that rings shows it; a slow one does not, and the text says so."""
    write_record(folder / "data.csv", record())

    out = " ".join(
        piezod("identify", "--verbose", "data.csv", "--no-creep", "--delay-s", 0.00135).out.split()
    )

    assert re.search(text, out)
    assert ("First mode at 180 ±" in out) == ("has no first mode" not in out)
