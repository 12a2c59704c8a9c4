"""Tests of the excitation that a record lacks, and of the recommended drive."""

from pathlib import Path

import numpy as np
import pytest

from piezod.config.experiment import load_experiment
from piezod.config.experiment_fields import IdentificationConfig
from piezod.config.yaml_loader import parse_yaml
from piezod.devices import registry
from piezod.experiment.fit.excitation import missing_excitation, recommended_drive, swings_of
from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray
from tests.experiment.made_up import POSITION_UM, record_of, sine

EXPERIMENTS = Path(__file__).parents[3] / "config" / "experiments"
PERIOD_S = 0.005


def followed(identification: IdentificationConfig) -> Record:
    """Return the record of a stage that follows a drive without hysteresis, 0.2 µm/V."""
    waveform = identification.drive_v.built(identification.duration_s)
    t_s = np.arange(0.0, identification.duration_s, PERIOD_S)
    drive_v = np.array(waveform.sample(t_s))
    return Record(t_s, drive_v, 0.2 * drive_v, run_in_s=identification.run_in_s)


def recommended(low_v: float, high_v: float) -> IdentificationConfig:
    """Return the recommended identification as the configuration reads it."""
    text = recommended_drive(low_v, high_v)
    return IdentificationConfig.model_validate(
        parse_yaml(text, "recommended").data["identification"]
    )


def zigzag(*ends: float) -> tuple[FloatArray, FloatArray]:
    """Return times in s and straight lines between the ends, one second each."""
    t_s = np.linspace(0.0, len(ends) - 1.0, 100 * (len(ends) - 1) + 1)
    return t_s, np.interp(t_s, np.arange(len(ends)), ends)


def test_returns_within_the_dead_band_are_no_swings() -> None:
    """A return by half a per cent is no turn."""
    swings = swings_of(*zigzag(0.0, 0.5, 0.495, 1.0, 0.2))

    assert swings.sizes == pytest.approx([1.0, 0.8])
    assert swings.middles == pytest.approx([0.5, 0.6])
    assert swings.durations_s == pytest.approx([3.0, 1.0])


def test_full_swings_of_one_frequency_lack_excitation() -> None:
    """They lack all smaller swings, slow motion, and a second frequency."""
    sizes = missing_excitation(record_of(path=sine))

    assert [each.split(":")[0] for each in sizes] == [
        f"Swings of {low} to {high} % of the range, {low_um:.3g} to {high_um:.3g} µm"
        for low, high in ((10, 20), (20, 40), (40, 70))
        for low_um, high_um in [(0.01 * low * POSITION_UM, 0.01 * high * POSITION_UM)]
    ] + [
        "Slow motion or holds, which show the creep",
        "A second frequency, which separates the delay from the width of the loops",
    ]


def test_loops_that_shrink_towards_one_end_lack_the_other_heights() -> None:
    """Small swings at the bottom do not determine those above."""
    ends = [0.0, *(end for top in (1.0, 0.9, 0.65, 0.3, 0.15) for end in (top, 0.0))]
    t_s, x = zigzag(*ends)

    heights = [each for each in missing_excitation(Record(t_s, x, 10.0 * x)) if "third" in each]

    assert len(heights) == 1
    assert "1 to 7 µm around the middle and the upper third" in heights[0]


@pytest.mark.parametrize("name", ["qiu.yaml", "beyond.yaml"])
def test_identification_of_the_experiments_lacks_nothing(name: str) -> None:
    """The drives of the project have all excitation."""
    identification = load_experiment(EXPERIMENTS / name, registry).identification

    assert identification is not None
    assert missing_excitation(followed(identification)) == ()


@pytest.mark.parametrize(("low_v", "high_v"), [(0.0, 150.0), (-20.0, 120.0), (1.23456, 7.65432)])
def test_recommended_drive_lacks_nothing(low_v: float, high_v: float) -> None:
    """It is valid, stays within the voltages, does not jump, and has all excitation."""
    identification = recommended(low_v, high_v)
    record = followed(identification)

    steps = np.abs(np.diff(record.drive_v)) / (high_v - low_v)
    assert low_v <= record.drive_v.min() <= record.drive_v.max() <= high_v
    assert record.drive_v.max() > high_v - 0.003
    assert steps.max() < 0.7 * np.pi * 5.0 * PERIOD_S * 1.01
    assert missing_excitation(record) == ()


def test_stage_that_rests_is_reported() -> None:
    """A displacement that never moves determines nothing."""
    t_s = np.arange(10.0)

    assert missing_excitation(Record(t_s, t_s, np.ones(10))) == ("The displacement does not move.",)
