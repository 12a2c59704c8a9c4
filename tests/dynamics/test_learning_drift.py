"""Learning on linear stages that drift: what is foreseen, and what is left alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.dynamics.drift import Drift
from piezod.dynamics.learning import Learner, Stop
from piezod.dynamics.model import FloatArray, Resonance, ResponseModel
from tests.dynamics.test_learning import COMMAND, KNOWN, PLAY_S, LinearStage, harmonics, learned

OTHER = ResponseModel(205e-6, (Resonance(801.0, 0.031),))
"""A response that is a little wrong."""
SMALLER = 15.0 + 0.5 * (COMMAND - 12.0)


class Blind(Drift):
    """A drift that foresees nothing within a waveform."""

    @property
    def is_seen(self) -> bool:
        return False

    def change(self, begin_s: float, end_s: float) -> FloatArray:
        return 0.0 * super().change(begin_s, end_s)


class DriftingStage(LinearStage):
    """A stage with 3 % less gain than known, whose gain and zero change from play to play."""

    def __init__(self, growth: float, rise: float = 0.0, noise: float = 1e-3) -> None:
        super().__init__(OTHER, 0.97, noise)
        self.growth, self.rise = growth, rise

    def on(self, _passes: int) -> None:
        """Go on to the next play."""
        self.gain += self.growth
        self.offset += self.rise


def errors_of(stage: DriftingStage, drift: Drift, passes: int = 8) -> list[float]:
    """Return the rms errors of all plays."""
    return learned(stage, Learner(COMMAND, harmonics(), passes, drift=drift), stage.on)[0]


@pytest.mark.parametrize(
    ("growth", "rise"), [(0.003, 0.0), (-0.003, 0.0), (0.0, 0.05), (0.002, -0.03)]
)
def test_drift_is_foreseen(growth: float, rise: float) -> None:
    """Correcting alone is late by one play; the smallest error falls to a fifth of that."""
    with_it = errors_of(DriftingStage(growth, rise), Drift())
    without = errors_of(DriftingStage(growth, rise), Blind())

    assert min(with_it) < 0.2 * min(without)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_constant_stage_is_left_alone(seed: int, noise: float) -> None:
    """Without a drift every input is the same as without looking for one."""
    stages = [DriftingStage(0.0, noise=noise) for _ in range(2)]
    for stage in stages:
        stage.rng = np.random.default_rng(seed)
    with_it, without = (
        errors_of(stage, drift) for stage, drift in zip(stages, (Drift(), Blind()), strict=True)
    )

    assert with_it == without


def test_error_that_only_drift_keeps_up_goes_on_falling() -> None:
    """Learning does not stop as settled before a drift that it has just seen is tried."""
    stage = DriftingStage(0.004)
    stage.gain = 1.004
    errors = errors_of(stage, Drift())

    assert min(errors[1:3]) > 0.9 * errors[0]
    assert errors[-1] < 0.2 * errors[0]


def test_drift_that_slows_down_is_not_overshot() -> None:
    """A zero that settles by three quarters per play is never worse than without foreseeing."""

    class Settling(DriftingStage):
        def on(self, _passes: int) -> None:
            self.offset += 0.25 * (1.0 - self.offset)

    with_it, without = (errors_of(Settling(0.0), drift) for drift in (Drift(), Blind()))
    shorter = min(len(with_it), len(without))

    assert max(np.subtract(with_it, without)[:shorter]) < 1e-3
    assert min(with_it) < 0.5 * min(without)


def test_jump_of_a_drifting_stage_ends_at_the_best_input() -> None:
    """The gain halves after the drift is known: the jump is not taken for a drift."""
    stage = DriftingStage(0.002)
    learner = Learner(COMMAND, harmonics(), 12)
    inputs: list[FloatArray] = []

    def change(passes: int) -> None:
        stage.on(passes)
        inputs.append(learner.best)
        if passes == 6:
            stage.gain /= 2.0

    errors, stop = learned(stage, learner, change)

    assert stop in {Stop.GREW, Stop.SETTLED}
    assert learner.best_pass == int(np.argmin(errors)) < 6
    assert learner.best is inputs[5]
    assert max(errors) < 1.2 * np.std(COMMAND)


@given(st.floats(0.9, 1.1), st.floats(-0.5, 0.5))
def test_next_waveform_begins_with_what_was_learned(gain: float, offset: float) -> None:
    """Scale and offset of the stage are those of the last play: the first error is small."""
    stage = LinearStage(KNOWN, gain, 1e-6, offset)
    drift = Drift()
    learned(stage, Learner(COMMAND, harmonics(), 10, drift=drift))
    (error, *_), _ = learned(stage, Learner(SMALLER, harmonics(), 0, drift=drift))

    assert error < 1e-3


def test_first_input_that_was_learned_before_is_left_alone() -> None:
    """It has its own scale and offset."""
    drift = Drift()
    stage = LinearStage(KNOWN, 0.9, 1e-6)
    learned(stage, Learner(COMMAND, harmonics(), 6, drift=drift))
    before = Learner(SMALLER, harmonics(), 0, first=1.02 * SMALLER, drift=drift)

    assert before.next(10 * PLAY_S) == pytest.approx(1.02 * SMALLER)
