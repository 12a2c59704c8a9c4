"""Tests of the experiment on fast motion: what the response of the stage brings."""

from functools import cache

import pytest

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.modes import Mode
from piezod.devices import registry
from piezod.experiment.virtual.run import run_experiment
from piezod.records.experiment_result import Recording
from tests.conftest import Figure
from tests.experiment.beyond import EXPERIMENTS, without_response

_FULL = {"kind": "triangle", "low": 0, "high": 150}
BRIEF = {
    "settle_s": 0.5,
    "run_in_s": 0.5,
    "duration_s": 3.5,
    "drive_v": {
        "kind": "sequence",
        "parts": (
            {"duration_s": 1.0, "waveform": {**_FULL, "frequency_hz": 1.0}},
            {
                "duration_s": 1.5,
                "waveform": {
                    **_FULL,
                    "frequency_hz": 3.0,
                    "envelope": {"kind": "decaying", "time_constant_s": 0.7},
                },
            },
            {"duration_s": 1.0, "waveform": {**_FULL, "frequency_hz": 5.0}},
        ),
    },
}
"""Short identification."""
LARGEST_PCT = {"1 Hz": 0.5, "10 Hz": 0.5, "50 Hz": 0.5, "100 Hz": 0.6, "200 Hz": 1.0}
"""Largest worst true error of any mode with the response, in % of the range."""


def config_of(*cases: str) -> ExperimentConfig:
    """Return the experiment with these cases only."""
    config = load_experiment(EXPERIMENTS / "dynamics.yaml", registry)
    chosen = tuple(case for case in config.cases if case.name in cases)
    return config.model_copy(update={"cases": chosen})


def recordings_of(config: ExperimentConfig) -> tuple[Recording, ...]:
    """Run an experiment."""
    return run_experiment(config, "", config.title, lambda _label, _share: None).recordings


@cache
def known(*cases: str) -> tuple[Recording, ...]:
    """Return the recordings of the experiment as it is."""
    return recordings_of(config_of(*cases))


def worst_pct(recording: Recording) -> float:
    """Return the worst true error, in % of the range."""
    return recording.metrics["true_tracking_max_pct"]


@pytest.mark.stress  # make test has the parts: preview, notch, and the inverse at 1 kHz
def test_sine_of_50_hz_is_followed_after_a_short_identification(figure: Figure) -> None:
    """Learning makes up for what the short record does not show."""
    config = config_of("50 Hz").model_copy(update={"modes": (Mode.ADAPTIVE,)})
    assert config.identification is not None
    brief = type(config.identification).model_validate(
        {"method": config.identification.method, **BRIEF}
    )
    (recording,) = recordings_of(config.model_copy(update={"identification": brief}))
    figure(f"50 Hz, short identification, worst error: {worst_pct(recording):.2f} %")

    assert worst_pct(recording) <= LARGEST_PCT["50 Hz"]


@pytest.mark.stress
def test_sine_of_50_hz_is_followed_within_half_a_percent(figure: Figure) -> None:
    """This holds in each mode."""
    errors = {each.mode: worst_pct(each) for each in known("50 Hz")}
    figure(f"50 Hz, worst error: {errors}")

    assert set(errors) == {Mode.FEEDFORWARD, Mode.ADAPTIVE, Mode.TRIMMED}
    assert max(errors.values()) <= LARGEST_PCT["50 Hz"]


@pytest.mark.stress
def test_response_halves_the_error_of_fast_motion() -> None:
    """From 50 Hz on; at 1 and 10 Hz the error has other reasons."""
    cases = "50 Hz", "100 Hz", "200 Hz"
    plain = without_response(config_of(*cases)).model_copy(update={"modes": (Mode.FEEDFORWARD,)})
    without = {each.case: worst_pct(each) for each in recordings_of(plain)}
    with_it = {each.case: worst_pct(each) for each in known(*cases) if each.mode == plain.modes[0]}

    assert all(with_it[case] < 0.5 * without[case] for case in cases)


@pytest.mark.stress
@pytest.mark.parametrize("case", LARGEST_PCT)
def test_sines_are_followed_up_to_200_hz(case: str, figure: Figure) -> None:
    """The errors are those of the page about the modes."""
    for each in known(*LARGEST_PCT):
        if each.case == case:
            rms_pct = each.metrics["true_tracking_rms_pct"]
            figure(f"{case}, {each.mode}: worst {worst_pct(each):.2f} %, rms {rms_pct:.2f} %")
            assert worst_pct(each) <= LARGEST_PCT[case]
