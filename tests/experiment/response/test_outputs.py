"""What a measurement leaves: the response file, the table, the figure."""

from datetime import UTC, datetime
from hashlib import sha256

import numpy as np
import pytest
from matplotlib.axes import Axes

from piezod.config.response_file import load_response
from piezod.control.law.response_files import response_model
from piezod.dynamics.fitting import fit_response
from piezod.dynamics.model import ResponseModel
from piezod.dynamics.steps import StepAnswer, predicted_step
from piezod.experiment.response.judgement import judged
from piezod.experiment.response.outputs import Written, write_response
from piezod.records.figures.response import response_figure
from piezod.records.figures.style import png_bytes
from piezod.records.response_record import AboutVoltage, ResponseRecord, without_hold
from tests.dynamics.made_up import model_of, noisy

RATE_HZ = 10_000.0
MODEL = model_of(2e-4, (450.0, 0.7, 1.3), (800.0, 0.03, -0.3))
T_S = np.arange(1, 400) / RATE_HZ


def about(offset_v: float, gain: float, seed: int, model: ResponseModel = MODEL) -> AboutVoltage:
    """Return a made-up measurement about a voltage."""
    response = noisy(model, 0.01, seed, np.geomspace(5.0, 1500.0, 90), gain)
    step = StepAnswer(T_S, predicted_step(model, T_S), 8)
    f = np.geomspace(1.0, 5000.0, 50)
    return AboutVoltage(
        offset_v=offset_v,
        amplitude_v=2.0,
        response=response,
        noise_hz=f,
        noise_um_per_rthz=1e-3 * np.ones(50),
        step=step,
    )


@pytest.fixture(scope="module")
def record() -> ResponseRecord:
    """Return measurements about two voltages with their model."""
    both = [about(50.0, 0.1, 1), about(100.0, 0.2, 2)]
    return judged("x", "made up", "multisine", RATE_HZ, both, "a remedy")


@pytest.fixture(scope="module")
def written(record: ResponseRecord, tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Return the files of these measurements."""
    path = tmp_path_factory.mktemp("response") / "r.yaml"
    return write_response(path, record, datetime(2024, 5, 1, tzinfo=UTC))


def panel(axes: list[Axes], letter: str) -> Axes:
    """Return the panel with a letter."""
    (found,) = [each for each in axes if each.get_title(loc="left").startswith(f"({letter})")]
    return found


def test_files_agree_with_the_fit(record: ResponseRecord, written: Written) -> None:
    """The response file has the model to the last bit, and the digest of the table."""
    file = load_response(written.response)
    assert response_model(file) == record.fit.model
    assert file.source is not None
    assert (file.source.file, file.source.sha256) == (
        "r.csv",
        sha256(written.table.read_bytes()).hexdigest(),
    )
    assert [gain.offset_v for gain in file.gains] == [50.0, 100.0]
    assert [gain.um_per_v for gain in file.gains] == pytest.approx([0.1, 0.2], rel=0.01)
    assert file.first_mode is not None
    assert file.first_mode.frequency_hz == pytest.approx(800.0, rel=0.001)
    assert written.figure.read_bytes().startswith(b"\x89PNG")


def test_table_has_all_lines_and_the_fit(written: Written) -> None:
    """Each line of each voltage has a row; where it was used, model and measurement agree."""
    table = np.genfromtxt(written.table, delimiter=",", names=True)

    assert table["offset_v"].size == 180
    used = table["used"] == 1.0
    assert 100 < np.count_nonzero(used) < 180  # the highest lines are lost in the noise
    off = table["gain_um_per_v"] - table["model_gain_um_per_v"]
    assert np.max(np.abs(off[used])) < 0.01


def test_figure_shows_measurements_and_model(record: ResponseRecord) -> None:
    """Magnitudes are divided by the gain of their voltage, and the model goes through them."""
    figure = response_figure(record)

    magnitude = panel(figure.axes, "a")
    assert magnitude.get_xlim()[1] > 1500.0
    (model,) = [line for line in magnitude.lines if line.get_label() == "model"]
    values = np.asarray(model.get_ydata(), dtype=np.float64)
    assert values[0] == pytest.approx(1.0, abs=0.02)
    f = np.asarray(model.get_xdata(), dtype=np.float64)
    assert f[np.argmax(values)] == pytest.approx(800.0, rel=0.01)
    legend = magnitude.get_legend()
    assert legend is not None
    assert {text.get_text() for text in legend.get_texts()} == {
        "model",
        "about 50 V",
        "about 100 V",
    }
    step = panel(figure.axes, "e")
    assert [line.get_label() for line in step.lines] == [*["mean of 8 steps"] * 2, "model"]
    assert figure.get_suptitle().count("\n") == 2


def test_response_without_a_resonance_is_drawn() -> None:
    """A delay alone has a figure, too, and no line for a mode."""
    alone = judged("x", "t", "recording", RATE_HZ, [about(0.0, 0.1, 3, model_of(1e-4))], "")

    figure = response_figure(alone)

    assert alone.fit.model.resonances == ()
    assert png_bytes(figure).startswith(b"\x89PNG")


def test_many_modes_are_a_warning() -> None:
    """A response that three resonances do not describe is told by its error."""
    f = np.geomspace(5.0, 1500.0, 90)
    modes = [(200.0, 0.01, 0.2), (330.0, 0.01, 0.2), (500.0, 0.01, 0.2), (800.0, 0.01, 0.2)]
    model = model_of(1e-4, *modes, (1200.0, 0.01, 0.2))
    measured = about(0.0, 0.1, 4)
    measured = AboutVoltage(
        **{**vars(measured), "response": noisy(model, 0.01, 4, f), "step": None}
    )

    (warning,) = judged("x", "t", "multisine", RATE_HZ, [measured], "").warnings

    assert "more than three modes" in warning


def test_hold_is_no_delay() -> None:
    """A stage whose samples show the voltage in force has a delay of half a period."""
    f = np.geomspace(1.0, 400.0, 60)

    turned = without_hold(noisy(model_of(0.0), 1e-3, 1, f), 1000.0)

    assert fit_response([turned], 1000.0).model.delay_s == pytest.approx(0.5e-3, rel=0.01)
