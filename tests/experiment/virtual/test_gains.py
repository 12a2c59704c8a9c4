"""Tests of the refusal of unsafe gains, as early as possible in an experiment."""

from pathlib import Path

import pytest

from piezod.config.axes import CompensatorConfig
from piezod.config.experiment import ExperimentConfig
from piezod.config.modes import Mode
from piezod.control.law.gains import check_gains
from piezod.errors import ModelError
from piezod.experiment.check_file import check_file
from piezod.experiment.virtual.run import run_experiment
from tests.experiment.conftest import Load

MODEL = Path(__file__).parents[3] / "config" / "models" / "simulated-stack.yaml"
LIMITS = "    limits:"
GREEDY = "    trim: {gain_per_s: 700}\n"
TRIMMED = "modes: [feedforward, trimmed]\n"
GIVEN = "    compensator: {delay_s: 0.00065}\n"
WITH_MODE = "    first_mode: {frequency_hz: 734, damping: 0.03}\n"

REFUSED = r"^axis x: a trim gain of 700 1/s is not safe: .*"


def check(config: ExperimentConfig) -> None:
    """Check the gains that are known before anything moves."""
    check_gains(config.axes, 1.0 / config.rate_hz, (Mode.TRIMMED,))


def phases(load: Load, text: str) -> list[str]:
    """Run an experiment that is refused; return its phases."""
    seen: list[str] = []
    with pytest.raises(ModelError, match=REFUSED):
        run_experiment(load(text), "", "", lambda label, _share: seen.append(label))
    return seen


def test_known_delay_refuses_a_trim_before_anything_moves(load: Load, short: str) -> None:
    """The configuration contains the delay."""
    assert phases(load, short.replace(LIMITS, GREEDY + GIVEN + LIMITS) + TRIMMED) == []


def test_identified_delay_refuses_a_trim_before_the_first_case(load: Load, short: str) -> None:
    """Only the identification has run."""
    seen = phases(load, short.replace(LIMITS, GREEDY + LIMITS) + TRIMMED)

    assert set(seen) == {"identification"}


def test_trim_counts_in_its_mode_only(load: Load, short: str) -> None:
    """Without mode `trimmed` any gain of the trim is allowed."""
    result = run_experiment(
        load(short.replace(LIMITS, GREEDY + LIMITS) + "modes: [feedforward]\n"),
        "",
        "",
        lambda _label, _share: None,
    )

    assert len(result.recordings) == 1


@pytest.mark.parametrize("gain_per_s", [50, 700])
def test_check_of_a_file_refuses_unsafe_gains(tmp_path: Path, short: str, gain_per_s: int) -> None:
    """It has the text of the experiment, as a problem of the file."""
    greedy = GREEDY.replace("700", str(gain_per_s))
    path = tmp_path / "greedy.yaml"
    path.write_text(short.replace(LIMITS, greedy + GIVEN + LIMITS) + TRIMMED, encoding="utf-8")

    error = check_file(path).error

    expected = f"{path}: axis x: a trim gain of 700 1/s is not safe: "
    assert (error is None) if gain_per_s == 50 else str(error).startswith(expected)


def test_lms_with_the_thresholds_of_a_model_file_is_refused(load: Load, short: str) -> None:
    """The experiment names a model with graded thresholds."""
    config = load(short)
    lms = {"model": MODEL, "compensator": CompensatorConfig(identifier="lms")}
    axis = config.axes["x"].model_copy(update=lms)

    with pytest.raises(ModelError, match="axis x: identifier lms needs even thresholds"):
        check(config.model_copy(update={"axes": {"x": axis}}))


def test_first_mode_counts(load: Load, short: str) -> None:
    """A gain that the delay allows is refused for the mode, and the text names the mode."""
    modest = "    trim: {gain_per_s: 250}\n" + GIVEN.replace("0.00065", "0.0001")
    without = short.replace(LIMITS, modest + LIMITS) + TRIMMED

    check(load(without))
    with pytest.raises(ModelError, match=r"first mode 734 Hz with damping 0\.03"):
        check(load(without.replace(LIMITS, WITH_MODE + LIMITS)))
