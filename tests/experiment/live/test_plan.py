"""Tests of the check of an experiment for a running stage, and of the unused parts of its file."""

from pathlib import Path

import pytest

from piezod.errors import ClientError, DataError
from piezod.experiment.live.plan import check_live, not_used
from piezod.experiment.live.setup import LiveSetup, read_setup
from tests.experiment.conftest import Load
from tests.experiment.live_fakes import FakeStage, stage_document


@pytest.fixture
def setup() -> LiveSetup:
    """Return the setup of the stage in the repository."""
    return read_setup(FakeStage())


def test_setup_is_that_of_the_daemon(setup: LiveSetup) -> None:
    """It has the rate, the axes, and the model in use with its zero at rest."""
    axis = setup.axes["x"]

    assert (setup.stage, setup.rate_hz, setup.seed) == ("fake", 1000.0, 1)
    assert axis.range_um == (0.0, 26.0)
    assert axis.model is not None
    assert axis.model.position_um.low == pytest.approx(0.0, abs=0.1)
    assert setup.safe_at_rest


def test_range_is_that_of_the_model_if_none_is_configured() -> None:
    """The daemon has the same range."""
    document = stage_document()
    del document["axes"]["x"]["command_range_um"]

    axis = read_setup(FakeStage(document)).axes["x"]

    assert axis.model is not None
    assert axis.range_um == tuple(axis.model.position_um)


def test_unexpected_answer_is_an_error() -> None:
    """The error says that the daemon may have another version."""
    with pytest.raises(ClientError, match="the same version"):
        read_setup(FakeStage({"rate_hz": 100.0}))


def test_experiment_that_fits(load: Load, short: str, setup: LiveSetup) -> None:
    """The unused parts of the file are reported."""
    config = load(short)

    check_live(config, setup)

    (sentence,) = not_used(config, setup)
    assert "the file's devices, seed, identification and axes, except their names" in sentence


def test_other_rate_and_other_axes_are_reported(load: Load, short: str) -> None:
    """The rate is that of the daemon; axes that are not in the file rest."""
    document = stage_document()
    document |= {"rate_hz": 200.0, "axes": {**document["axes"], "y": document["axes"]["x"]}}

    _, rate, others = not_used(load(short), read_setup(FakeStage(document)))

    assert rate == (
        "rate_hz of the file, 1000 Hz, was not used: stage fake runs at 200 Hz."
    )  # fmt: skip
    assert others.endswith("that rested: y.")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("high: 20", "high: 26.5", "slow commands 0 to 26.5 µm, but axis x may be commanded from"),
        ("low: 0, high: 20", "low: -3, high: 20", "slow commands -3 to 20 µm, but axis x was"),
        ("  x:\n", "  z:\n", "stage fake: no axis z; its axes are x"),
        ("settle_s: 0.5\ncases", "metrics: [noise_rms_pct]\ncases", "metrics requests noise_rms"),
    ],
)
def test_experiment_that_does_not_fit(
    load: Load, short: str, setup: LiveSetup, old: str, new: str, problem: str
) -> None:
    """It is refused before anything moves, with the allowed values."""
    assert old in short

    with pytest.raises(DataError) as caught:
        check_live(load(short.replace(old, new)), setup)

    assert problem in str(caught.value)


def test_slow_stage_leaves_too_few_samples(load: Load, short: str) -> None:
    """A case can be too short at the rate of the stage."""
    setup = read_setup(FakeStage(stage_document() | {"rate_hz": 4.0}))

    with pytest.raises(DataError, match=r"slow leaves 8.0 samples after period_s at 4 Hz"):
        check_live(load(short), setup)


def test_stage_without_a_model_runs_uncompensated_only(load: Load, short: str) -> None:
    """The other modes need a model; the error says how to make one."""
    stage = FakeStage()
    stage.model = None
    setup = read_setup(stage)

    check_live(load(short + "modes: [uncompensated]\n"), setup)
    with pytest.raises(DataError, match=r"mode feedforward needs; `piezod identify --live"):
        check_live(load(short), setup)


def test_stage_without_a_sensor_runs_no_experiment(load: Load, short: str) -> None:
    """Its errors could not be measured."""
    setup = read_setup(FakeStage(stage_document(sensor=None)))

    with pytest.raises(DataError, match="axis x has no sensor, and an experiment measures its"):
        check_live(load(short), setup)


def test_case_that_is_too_large_for_the_loop_is_refused(
    load: Load, short: str, setup: LiveSetup
) -> None:
    """The check finds it before anything moves, like the daemon later."""
    sine = "{kind: sine, low: 0, high: 20, frequency_hz: 1}"
    parts = ", ".join(
        ["{duration_s: 1, waveform: {kind: sum, parts: [%s, %s, %s]}}" % ((sine,) * 3)] * 50
    )
    text = short.replace(sine, f"{{kind: sequence, parts: [{parts}]}}")

    with pytest.raises(DataError, match="slow cannot be sent: the waveforms have too many parts"):
        check_live(load(text), setup)


@pytest.mark.parametrize(
    ("points", "problem"),
    [
        (9_999, r"slow has waveforms of \d+ bytes, allowed: at most 262144; use fewer points"),
        (12_000, "slow cannot be sent: "),
    ],
)
def test_file_with_too_many_points_is_refused(
    load: Load, short: str, setup: LiveSetup, tmp_path: Path, points: int, problem: str
) -> None:
    """The check finds it before the experiment starts."""
    rows = (f"{i / 7.0 / points},{13.0 + i / 3.0 / points}" for i in range(points))
    (tmp_path / "path.csv").write_text("\n".join(["t_s,x", *rows]), encoding="utf-8")
    sine = "{kind: sine, low: 0, high: 20, frequency_hz: 1}"
    config = load(short.replace(sine, "{kind: csv, path: path.csv, column: x}"))

    with pytest.raises(DataError, match=problem):
        check_live(config, setup)
