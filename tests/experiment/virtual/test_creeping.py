"""How far a stage has crept, from run to run."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.law.creep import CreepLaw
from piezod.control.law.model import StageModel
from piezod.experiment.virtual.creeping import Creeping
from piezod.hysteresis import AffineRange, add_creep, even_thresholds, new_bank
from piezod.hysteresis.memory import FloatArray

PERIOD_S = 0.01
LAW = CreepLaw(np.array([0.1, 1.0, 10.0]), np.array([0.01, 0.02, 0.03]))
WIDTH_UM = 30.0
BANK = new_bank(even_thresholds(2), even_thresholds(2))


def model_at(rest: float, law: CreepLaw = LAW) -> StageModel:
    """Return a model that counts the displacement from a rest within its range."""
    position_um = AffineRange(-rest * WIDTH_UM, (1.0 - rest) * WIDTH_UM)
    return StageModel(BANK, np.zeros(4), AffineRange(0.0, 150.0), position_um, 0.0, law)


class Sensor:
    """A stage that creeps, seen by a sensor that is zeroed now and then; all without a break."""

    def __init__(self, rest: float) -> None:
        self.rest = rest
        self.lags = np.full(3, rest)
        self._quick = rest
        self._zeroed = float(LAW.weights @ self.lags)

    def run(self, quick: FloatArray) -> FloatArray:
        """Return what is measured while the quick displacement takes this way, in µm."""
        x = add_creep(LAW.at(PERIOD_S), quick, self.lags, self._quick)
        self._quick = float(quick[-1])
        return WIDTH_UM * (x - self._zeroed - self.rest)

    def zero(self) -> None:
        """Call the displacement zero, at rest."""
        self._zeroed = float(LAW.weights @ self.lags)


def way(rest: float, to: float) -> FloatArray:
    """Return a way from rest to somewhere else and back, ten seconds long, shape (n,)."""
    return rest + (to - rest) * np.sin(np.linspace(0.0, np.pi, 1000)) ** 2


@pytest.mark.parametrize("rest", [0.0, 0.4])
def test_creep_is_known_through_runs_and_zeros(rest: float) -> None:
    """After any number of runs, each followed by a rest and a zero, the lags are the stage's."""
    stage, creeping = Sensor(rest), Creeping(model_at(rest), PERIOD_S)

    for to in (0.9, 0.2, 0.6):
        for quick in (way(rest, to), np.full(200, rest)):
            creeping.watch(stage.run(quick))
        creeping.zero()
        stage.zero()

    state = creeping.state
    assert state.lags == pytest.approx(stage.lags, abs=1e-12)
    assert state.zeroed == pytest.approx(LAW.weights @ stage.lags, abs=1e-12)
    assert state.quick == pytest.approx(rest, abs=1e-12)
    assert np.max(np.abs(state.lags - rest)) > 0.04


@given(cuts=st.lists(st.integers(0, 1000), max_size=5).map(sorted))
def test_pieces_are_as_good_as_the_whole(cuts: list[int]) -> None:
    """However a record is cut, the creep after it is the same, to the bit."""
    measured_um = Sensor(0.0).run(way(0.0, 0.8))
    whole, pieces = (Creeping(model_at(0.0), PERIOD_S) for _ in range(2))

    whole.watch(measured_um)
    for piece in np.split(measured_um, cuts):
        pieces.watch(piece)

    assert pieces.state.lags.tolist() == whole.state.lags.tolist()
    assert pieces.state.quick == whole.state.quick


def test_samples_that_are_missing_count_as_the_last_one() -> None:
    """And those before the first as that one."""
    measured_um = np.array([5.0, 5.0, 6.0, 6.0, 6.0, 7.0])
    with_gaps_um = np.array([np.nan, 5.0, 6.0, np.nan, np.nan, 7.0])
    whole, gaps = (Creeping(model_at(0.0), PERIOD_S) for _ in range(2))

    whole.watch(measured_um)
    gaps.watch(with_gaps_um)

    assert gaps.state.lags.tolist() == whole.state.lags.tolist()


def test_stage_without_creep_has_none_to_follow() -> None:
    """It starts from rest, wherever that is."""
    creeping = Creeping(model_at(0.3, CreepLaw(np.empty(0), np.empty(0))), PERIOD_S)

    creeping.watch(np.linspace(0.0, 9.0, 10))
    creeping.zero()

    assert creeping.state.lags.size == 0
    assert (creeping.state.zeroed, creeping.state.quick) == (0.0, 0.3)
