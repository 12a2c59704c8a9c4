"""Tests of the creep that is followed from run to run."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.control.law.creep import CreepLaw
from piezod.control.law.model import StageModel
from piezod.experiment.virtual.creeping import Creeping
from piezod.hysteresis import (
    AdaptiveIdentifier,
    AffineRange,
    RLSIdentifier,
    StopForm,
    SurfaceForm,
    SurfaceIdentifier,
    add_creep,
)
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import BACKLASH
from tests.control.made_up import LINE, RELAXING, STOPS, SURFACE, Kind, wander

PERIOD_S = 0.01
LAW = CreepLaw(np.array([0.1, 1.0, 10.0]), np.array([0.01, 0.02, 0.03]))
WIDTH_UM, RANGE_V = 30.0, 150.0
FORM = StopForm.even(2)


def model_at(rest: float, law: CreepLaw = LAW) -> StageModel:
    """Return a model whose zero is at a rest within its range."""
    position_um = AffineRange(-rest * WIDTH_UM, (1.0 - rest) * WIDTH_UM)
    return StageModel(FORM, np.zeros(4), AffineRange(0.0, RANGE_V), position_um, 0.0, law)


class CreepingStage:
    """A stage that creeps without interruption, with a sensor that can be zeroed."""

    def __init__(self, rest: float) -> None:
        self.rest = rest
        self.lags = np.full(3, rest)
        self._quick = rest
        self._zeroed = float(LAW.weights @ self.lags)

    def run(self, quick: FloatArray) -> FloatArray:
        """Return the measured positions for displacements without creep, in µm."""
        x = add_creep(LAW.at(PERIOD_S), quick, self.lags, self._quick)
        self._quick = float(quick[-1])
        return WIDTH_UM * (x - self._zeroed - self.rest)

    def zero(self) -> None:
        """Zero the sensor at rest."""
        self._zeroed = float(LAW.weights @ self.lags)


def excursion(rest: float, to: float) -> FloatArray:
    """Return ten seconds from rest to another displacement and back, shape (n,)."""
    return rest + (to - rest) * np.sin(np.linspace(0.0, np.pi, 1000)) ** 2


@pytest.mark.parametrize("rest", [0.0, 0.4])
def test_creep_is_followed_through_runs_and_zeros(rest: float) -> None:
    """After any number of runs, rests and zeros, the lags are those of the stage."""
    model = model_at(rest)
    stage, creeping = CreepingStage(rest), Creeping(model, RANGE_V * rest, PERIOD_S)

    for to in (0.9, 0.2, 0.6):
        for quick in (excursion(rest, to), np.full(200, rest)):
            creeping.watch(stage.run(quick))
        creeping.zero()
        stage.zero()

    state = creeping.state
    assert state.lags == pytest.approx(stage.lags, abs=1e-12)
    assert state.zeroed == pytest.approx(LAW.weights @ stage.lags, abs=1e-12)
    assert state.quick == pytest.approx(rest, abs=1e-12)
    assert np.max(np.abs(state.lags - rest)) > 0.04


@given(cuts=st.lists(st.integers(0, 1000), max_size=5).map(sorted))
def test_creep_does_not_depend_on_the_cuts_of_a_record(cuts: list[int]) -> None:
    """The creep after the record is the same to the bit for any cuts."""
    measured_um = CreepingStage(0.0).run(excursion(0.0, 0.8))
    whole, pieces = (Creeping(model_at(0.0), 0.0, PERIOD_S) for _ in range(2))

    whole.watch(measured_um)
    for piece in np.split(measured_um, cuts):
        pieces.watch(piece)

    assert pieces.state.lags.tolist() == whole.state.lags.tolist()
    assert pieces.state.quick == whole.state.quick


def test_missing_samples_count_as_the_last_one() -> None:
    """Those before the first sample count as the first."""
    measured_um = np.array([5.0, 5.0, 6.0, 6.0, 6.0, 7.0])
    with_gaps_um = np.array([np.nan, 5.0, 6.0, np.nan, np.nan, 7.0])
    whole, gaps = (Creeping(model_at(0.0), 0.0, PERIOD_S) for _ in range(2))

    whole.watch(measured_um)
    gaps.watch(with_gaps_um)

    assert gaps.state.lags.tolist() == whole.state.lags.tolist()


def test_stage_without_creep_starts_at_rest() -> None:
    """The rest may be anywhere in the range."""
    model = model_at(0.3, CreepLaw(np.empty(0), np.empty(0)))
    creeping = Creeping(model, 0.3 * RANGE_V, PERIOD_S)

    creeping.watch(np.linspace(0.0, 9.0, 10))
    creeping.zero()

    assert creeping.state.lags.size == 0
    assert (creeping.state.zeroed, creeping.state.quick) == pytest.approx((0.0, 0.3), abs=1e-12)


def identifier_of(kind: Kind) -> AdaptiveIdentifier:
    """Return an identifier that knows the weights."""
    if isinstance(kind.form, SurfaceForm):
        return SurfaceIdentifier(kind.weights, kind.form)
    assert isinstance(kind.form, StopForm)
    return RLSIdentifier(kind.form.bank, kind.weights)


@pytest.mark.parametrize(
    ("kind", "rest"),
    [(RELAXING, 0.0), (LINE, 0.4), (SURFACE, 0.0), (SURFACE, 0.4), (STOPS, 0.4)],
    ids=["path", "path, inside", "surface", "surface, inside", "stops, inside"],
)
def test_past_is_followed_through_runs_and_zeros(kind: Kind, rest: float) -> None:
    """A law that starts from the followed state keeps to its commands from the new zero."""
    form, weights, rest_v = kind.form, kind.weights, RANGE_V * rest
    at_zero = StageModel(form, weights, AffineRange(0.0, RANGE_V), AffineRange(0.0, WIDTH_UM), 0.0)
    model = at_zero.zeroed_at(rest_v)
    creeping, stage = Creeping(model, rest_v, PERIOD_S), form.past(weights)
    relaxed = model.at_rest(rest_v, PERIOD_S)
    nominal = relaxed.quick
    assert relaxed.memory is not None
    stage.take_over(relaxed.memory)
    for to in (0.9, 0.3):
        drives = excursion(rest, to)
        creeping.follow(RANGE_V * drives)
        zero = stage.follow(drives) - nominal
        creeping.zero()
    state, mode = creeping.state, Mode.FEEDFORWARD
    subject = Compensator(form, weights, mode=mode, fade_cycles=1, creep=state)
    assert state.memory is not None

    commands = nominal + 0.3 * wander(2.0) * (1.0 - rest)
    drives = np.array(kind.drives(subject, commands))
    positions = np.array([stage.follow(np.array([drive])) for drive in drives])
    identifier = identifier_of(kind)
    identifier.take_over(state.memory)
    errors = [identifier.step(*pair, learn=False) for pair in zip(positions, drives, strict=True)]

    assert (abs(zero) > 5e-3) == (rest > 0.0 or kind is RELAXING)
    assert positions - zero == pytest.approx(commands, abs=BACKLASH)
    assert np.abs(errors).max() < BACKLASH
