"""Tests of an hour at rest and an hour of random commands, in virtual time."""

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.config.waveforms.paths import Reversals
from piezod.hysteresis.slopes import LEAST_SLOPE, cells, fill_slopes, least_slope
from tests.conftest import Figure
from tests.experiment.made_up import stops_of
from tests.experiment.stress_rig import (
    HIGH_UM,
    LOW_UM,
    Identified,
    StressRig,
    errors_pct,
    listed,
    swing_um,
    worst_pct,
)

REST_RATE_HZ = 200.0
"""Rate of the loop at rest, in Hz: an hour at 1 kHz takes minutes to simulate and shows no more."""
HOUR_S = 3600.0
GRADIENTS_S = 600.0
"""Random commands at 1 kHz, for identifiers that serve as a comparison."""
UNSEEN_PCT = 1.5
"""Allowed creep at rest without a trim: lags slower than the identified ones are not
compensated."""
PART_S = 20.0
"""Length of a recorded part, in s."""


def hours(short_s: float) -> list[object]:
    """Return the duration of the short version, and of the long one."""
    return [short_s, pytest.param(HOUR_S, marks=pytest.mark.stress)]


def rest(stage: Identified, mode: Mode, duration_s: float, figure: Figure) -> None:
    """Swing, then hold; assert that nothing is learned after the first second of the rest."""
    moves_s = 4.3
    rig = StressRig(stage.at(REST_RATE_HZ), lambda t_s: swing_um(min(t_s, moves_s)), mode)
    before = rig.learned
    rig.run(moves_s)
    moved_pct = rig.moved_pct(before, rig.learned)
    rig.run(1.0)
    learned = rig.learned
    rig.run(1.0)  # in which the compensator still comes closer
    in_use = rig.axis.compensator.weights.copy()
    worst = [worst_pct(rig.run(PART_S)) for _ in range(round(duration_s / PART_S))]
    identifier = stage.config.axes["x"].compensator.identifier
    same = np.array_equal(rig.learned, learned)
    figure(
        f"rest of {duration_s:g} s, {mode.value}, {identifier}: weights moved by {moved_pct:.2f} % "
        f"before, {'the same to the bit' if same else 'CHANGED'} since; worst true error "
        f"{max(worst):.2f} %, in the last part {worst[-1]:.2f} %"
    )

    assert moved_pct > 0.0
    assert same
    assert np.array_equal(rig.axis.compensator.weights, in_use)
    assert max(worst) < (0.5 if mode is Mode.TRIMMED else UNSEEN_PCT)


@pytest.mark.parametrize("duration_s", hours(20.0))
@pytest.mark.parametrize(
    "mode", [pytest.param(Mode.ADAPTIVE, marks=pytest.mark.stress), Mode.TRIMMED]
)
def test_nothing_is_learned_at_rest(
    beyond_stage: Identified, figure: Figure, mode: Mode, duration_s: float
) -> None:
    """With RLS all parameters stay the same to the bit after the first second."""
    rest(beyond_stage.trimming_adaptive(), mode, duration_s, figure)


@pytest.mark.stress
@pytest.mark.parametrize("identifier", ["lms", "nlms"])
def test_nothing_is_learned_at_rest_by_gradients(
    even_stage: Identified, figure: Figure, identifier: str
) -> None:
    """The same holds for LMS and normalised LMS."""
    rest(even_stage.learning_by(identifier), Mode.ADAPTIVE, HOUR_S, figure)


def random_commands(stage: Identified, duration_s: float, most_pct: float, figure: Figure) -> None:
    """Follow random commands; assert that the model has an inverse at every step."""
    command = Reversals(
        kind="reversals", low=LOW_UM, high=HIGH_UM, min_swing=0.5, min_speed=1, max_speed=50, seed=4
    )
    rig = StressRig(stage, command.built(duration_s).value)
    bank, weights = stops_of(stage.model).bank, rig.axis.identifier.weights
    widths = cells(bank)
    slopes, least = np.empty_like(widths), np.inf

    def watch(_cycle: int) -> None:
        nonlocal least
        fill_slopes(bank, weights, slopes)
        least = min(least, least_slope(slopes, widths))

    parts = [rig.run(PART_S, watch) for _ in range(round(duration_s / PART_S))]
    worst = np.array([worst_pct(part) for part in parts])
    rms = np.array([np.sqrt(np.mean(errors_pct(part) ** 2)) for part in parts])
    identifier = stage.config.axes["x"].compensator.identifier
    figure(
        f"random commands for {duration_s:g} s, {identifier}: smallest slope anywhere {least:.9f}; "
        f"pairs merged {rig.merged_pairs}, models restored {rig.restored}; worst true error "
        f"{worst.max():.2f} %, rms {np.sqrt(np.mean(rms**2)):.2f} %; worst in the first and in the "
        f"last part {listed(worst[[0, -1]])} %"
    )

    assert least >= LEAST_SLOPE - 1e-12
    assert rig.merged_pairs == 0
    assert worst.max() < most_pct


@pytest.mark.parametrize("duration_s", hours(20.0))
def test_random_commands_leave_a_model_that_can_be_inverted(
    beyond_stage: Identified, figure: Figure, duration_s: float
) -> None:
    """With RLS the inverse always exists, no loop is lost, and errors stay small."""
    random_commands(beyond_stage, duration_s, 1.0, figure)


@pytest.mark.stress
@pytest.mark.parametrize(("identifier", "most_pct"), [("lms", 3.0), ("nlms", 1.5)])
def test_random_commands_leave_gradients_a_model_that_can_be_inverted(
    even_stage: Identified, figure: Figure, identifier: str, most_pct: float
) -> None:
    """The same holds for LMS and normalised LMS."""
    random_commands(even_stage.learning_by(identifier), GRADIENTS_S, most_pct, figure)
