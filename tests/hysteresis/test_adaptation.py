"""The contract of every identifier for any input, and the shadow that undoes bad learning."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import (
    AdaptiveIdentifier,
    LMSIdentifier,
    NLMSIdentifier,
    RLSIdentifier,
    Shadowed,
    even_thresholds,
    new_bank,
    stop_regressors,
)
from piezod.hysteresis.learner import OFFSET_LIMIT, SCALE_LIMIT
from piezod.hysteresis.slopes import LEAST_SLOPE, smallest_slope_of
from tests.hysteresis.draw import command, inputs

Array = NDArray[np.float64]
BANK = new_bank(even_thresholds(19), even_thresholds(19))
SMALL = new_bank([0.1, 0.4, 0.7], [0.2, 0.5, 0.9])
KNOWN = np.linspace(0.04, 0.0, 38)

Maker = Callable[[Array], AdaptiveIdentifier]
MAKERS: dict[str, Maker] = {
    "LMS": LMSIdentifier,
    "NLMS": lambda bank: NLMSIdentifier(bank, gain=1.9),
    "RLS": lambda bank: RLSIdentifier(bank, np.zeros(bank.shape[1])),
    "RLS that walks far": lambda bank: RLSIdentifier(
        bank, np.zeros(bank.shape[1]), weight_walk=5e-4, offset_walk=5e-5, scale_walk=5e-5
    ),
    "shadowed RLS": lambda bank: Shadowed(
        RLSIdentifier(bank, np.zeros(bank.shape[1])), window=5, tolerance=1.0
    ),
}
every = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS.keys())


def drives_for(positions: Array) -> Array:
    """Return the drives of a known model."""
    return positions + stop_regressors(BANK, positions) @ KNOWN


def learned_by(identifier: AdaptiveIdentifier) -> list[float]:
    """Return the learned model: weights, offset and scale."""
    return [*identifier.weights.tolist(), identifier.offset, identifier.scale]


def assert_sound(identifier: AdaptiveIdentifier, bank: Array) -> None:
    """Assert that the weights have an inverse, and that a covariance is valid and bounded."""
    assert np.all(np.isfinite(identifier.weights))
    assert abs(identifier.offset) <= OFFSET_LIMIT
    assert abs(identifier.scale) <= SCALE_LIMIT
    assert smallest_slope_of(bank, identifier.weights) >= LEAST_SLOPE - 1e-12
    if isinstance(identifier, RLSIdentifier):
        covariance = identifier.covariance
        assert np.array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] >= -1e-14
        assert np.max(covariance) <= 1.001e-3


@every
@settings(max_examples=40)
@pytest.mark.fault("D3")
@given(
    positions=inputs(least=5, most=60),
    seed=st.integers(0, 99),
    noise=st.sampled_from([1e-3, 0.3, 10.0]),
    spoiled=st.sets(st.integers(0, 59)),
)
def test_an_inverse_exists_after_every_step_for_any_pairs(
    make: Maker, positions: Array, seed: int, noise: float, spoiled: set[int]
) -> None:
    """Jumps, tiny loops, unrelated drives and values that are not finite leave the model sound."""
    random = np.random.default_rng(seed)
    identifier = make(SMALL)
    for k, position in enumerate(positions):
        pair = [position, position + noise * random.standard_normal()]
        if k in spoiled:
            pair[random.integers(2)] = random.choice([math.nan, math.inf, -math.inf])

        identifier.step(*pair)

        assert_sound(identifier, SMALL)


@pytest.mark.parametrize("dwell_s", [20.0, pytest.param(100.0, marks=pytest.mark.stress)])
@every
def test_tiny_amplitude_and_then_full_swing_do_not_diverge(make: Maker, dwell_s: float) -> None:
    """After a dwell at 1 % amplitude, errors of full swings stay below those without a model."""
    dwell, swing = command(dwell_s, 0.005), command(8.0)
    positions = np.concatenate((dwell, swing))
    drives = drives_for(positions)
    identifier = make(BANK)

    errors = identifier.run(positions + np.tile([1e-4, -1e-4], positions.size // 2), drives)

    assert np.max(np.abs(errors)) < 1.2 * np.max(np.abs(drives - positions))
    assert np.max(np.abs(errors[-4000:])) < 0.02
    assert_sound(identifier, BANK)


@every
@pytest.mark.parametrize("spoiled", [math.nan, math.inf, -math.inf])
def test_a_pair_that_is_not_finite_teaches_nothing(make: Maker, spoiled: float) -> None:
    """The learned model stays to the bit; without a displacement the memory stays too."""
    identifier = make(BANK)
    identifier.run(command(1.0), drives_for(command(1.0)))
    before = [*learned_by(identifier), identifier.position]

    errors = [identifier.step(spoiled, 0.5)]
    held = identifier.position
    errors.append(identifier.step(0.9, spoiled))

    assert not np.any(np.isfinite(errors))
    assert [*learned_by(identifier), held] == before
    expected = (1.0 + identifier.scale) * 0.9 - identifier.offset
    assert identifier.position == pytest.approx(expected)


@every
def test_without_learning_only_the_memory_advances(make: Maker) -> None:
    """The learned model stays to the bit, and the operators follow the displacement."""
    identifier, twin = make(BANK), make(BANK)
    for one in (identifier, twin):
        one.run(command(1.0), drives_for(command(1.0)))
    learned = learned_by(identifier)

    for position in command(4.0):
        identifier.step(position, 0.7, learn=False)
        twin.step(position, math.nan)

    assert learned_by(identifier) == learned
    assert identifier.step(0.6, 0.6) == twin.step(0.6, 0.6)


@every
def test_steps_are_a_run_to_the_bit(make: Maker) -> None:
    """Steps pair by pair and a run over the record give the same numbers."""
    positions, drives = command(2.0), drives_for(command(2.0))
    stepped, run = make(BANK), make(BANK)

    errors = [stepped.step(x, v) for x, v in zip(positions, drives, strict=True)]

    assert errors == run.run(positions, drives).tolist()
    assert learned_by(stepped) == learned_by(run)


@every
def test_error_of_a_step_is_the_drive_minus_the_own_prediction(make: Maker) -> None:
    """This holds without learning, and outside the range too."""
    identifier = make(BANK)
    identifier.run(command(2.0), drives_for(command(2.0)))
    for position in (0.2, 0.8, 1.01, -0.01, 0.4):
        error = identifier.step(position, 0.5, learn=False)

        predicted = identifier.predict(identifier.weights, identifier.offset, identifier.scale)
        assert error == pytest.approx(0.5 - predicted, abs=1e-15)


@every
def test_other_models_predict_with_the_same_memory(make: Maker) -> None:
    """A known model predicts its own drive; offset and scale shift that prediction."""
    positions = command(2.0)
    identifier = make(BANK)
    for position in positions:
        identifier.step(position, 0.5, learn=False)

    known = identifier.predict(KNOWN, 0.0, 0.0)
    moved = known + 0.05 * positions[-1] - 0.01
    assert known == pytest.approx(drives_for(positions)[-1], abs=1e-12)
    assert identifier.predict(KNOWN, 0.01, 0.05) == pytest.approx(moved)


@every
def test_reset_clears_the_memory_and_keeps_the_learned_model(make: Maker) -> None:
    """A new record starts from rest, with the same weights, offset and scale."""
    identifier = make(BANK)
    identifier.run(command(3.0), drives_for(command(3.0)))
    learned = learned_by(identifier)

    identifier.reset()

    assert learned_by(identifier) == learned
    assert identifier.position == 0.0
    assert identifier.merged_pairs == 0


@every
def test_adopted_models_are_taken_over_in_place(make: Maker) -> None:
    """The weights stay the same array, so that a reference to it stays valid."""
    identifier = make(BANK)
    weights = identifier.weights

    identifier.adopt(KNOWN, 0.01, 0.05)

    assert identifier.weights is weights
    assert learned_by(identifier) == [*KNOWN.tolist(), 0.01, 0.05]


@every
def test_adopted_models_without_an_inverse_are_projected(make: Maker) -> None:
    """An adopted model has a smallest slope of at least `LEAST_SLOPE`."""
    identifier = make(BANK)

    identifier.adopt(np.full(38, 5.0))

    assert smallest_slope_of(BANK, identifier.weights) >= LEAST_SLOPE


@every
def test_invalid_models_are_not_adopted(make: Maker) -> None:
    """Values that are not finite, out of bounds or too few are refused, and nothing changes."""
    identifier = make(BANK)
    for weights, offset in ((KNOWN[1:], 0.0), (np.full(38, np.nan), 0.0), (KNOWN, math.nan)):
        with pytest.raises(ModelError, match="need 38 finite weights and a finite offset"):
            identifier.adopt(weights, offset)
    for scale in (0.31, -0.31, math.nan):
        with pytest.raises(ModelError, match=r"a scale must be from -0\.3 to 0\.3"):
            identifier.adopt(KNOWN, 0.0, scale)

    assert learned_by(identifier) == [0.0] * 40


def test_learning_that_made_it_worse_is_undone() -> None:
    """A disturbance that was learned at the end of one window is detected in the next.

    A slow learner alone would keep its effect for long; the shadow still predicts well.
    """
    positions, drives = command(3.0), drives_for(command(3.0))
    drives[1700:2000] += 0.1
    drives += 1e-4 * np.random.default_rng(1).standard_normal(drives.size)
    alone, guarded = LMSIdentifier(BANK, gain=1e-3), LMSIdentifier(BANK, gain=1e-3)
    shadowed = Shadowed(guarded, window=1000)
    for one in (alone, shadowed):
        one.adopt(KNOWN)
        one.run(positions, drives)

    assert shadowed.restored == 1
    assert np.max(np.abs(shadowed.weights - KNOWN)) < 1e-4
    assert np.max(np.abs(alone.weights - KNOWN)) > 1e-3


def test_a_learner_too_wild_for_the_noise_is_held() -> None:
    """A gain that amplifies noise never predicts better than the initial model."""
    positions = command(3.0)
    noise = 1e-2 * np.random.default_rng(1).standard_normal(positions.size)
    shadowed = Shadowed(NLMSIdentifier(BANK, gain=1.9), window=500)
    shadowed.adopt(KNOWN)

    shadowed.run(positions, drives_for(positions) + noise)

    assert shadowed.restored == 6
    assert shadowed.weights.tolist() == KNOWN.tolist()


def test_offset_and_scale_are_restored_with_the_weights() -> None:
    """Noise that was learned as drift and as a change of gain is undone completely."""
    positions = command(3.0)
    noise = 1e-2 * np.random.default_rng(1).standard_normal(positions.size)
    shadowed = Shadowed(RLSIdentifier(BANK, KNOWN, weight_walk=1e-4), window=500, tolerance=1.0)
    shadowed.adopt(KNOWN, 0.01, 0.05)
    displacements = (positions + 0.01) / 1.05

    shadowed.run(displacements[:2999], (drives_for(positions) + noise)[:2999])
    went = learned_by(shadowed)
    shadowed.step(displacements[2999], 0.0)

    assert abs(went[-2] - 0.01) > 1e-3
    assert abs(went[-1] - 0.05) > 1e-3
    assert shadowed.restored == 6
    assert learned_by(shadowed) == [*KNOWN.tolist(), 0.01, 0.05]


def test_learning_that_made_it_better_is_kept() -> None:
    """A shadow does not change the result of a good learner."""
    positions, drives = command(10.0), drives_for(command(10.0))
    alone = RLSIdentifier(BANK, np.zeros(38))
    shadowed = Shadowed(RLSIdentifier(BANK, np.zeros(38)), window=500)

    errors = shadowed.run(positions, drives)

    assert shadowed.restored == 0
    assert errors.tolist() == alone.run(positions, drives).tolist()


def test_windows_count_pairs_that_were_learned_from() -> None:
    """Pairs without learning do not count, and a reset starts a new window."""
    shadowed = Shadowed(NLMSIdentifier(BANK, gain=1.9), window=3)
    for learn, drive in ((True, 0.9), (False, 0.1), (True, math.nan), (True, 0.1)):
        shadowed.step(0.5, drive, learn)
    shadowed.reset()
    for position, drive in ((0.5, 0.6), (0.3, 0.2)):
        shadowed.step(position, drive)
    assert shadowed.restored == 0

    shadowed.step(0.5, 0.9)
    assert shadowed.restored == 1


@pytest.mark.parametrize(
    ("window", "tolerance"), [(0, 2.0), (-1, 2.0), (10, 0.9), (10, math.inf), (10, math.nan)]
)
def test_invalid_windows_and_tolerances_are_refused(window: int, tolerance: float) -> None:
    """A window has at least one pair, and the tolerance must not call equal models worse."""
    with pytest.raises(ModelError, match="window of 1 pair or more and a tolerance of 1 or more"):
        Shadowed(LMSIdentifier(BANK), window=window, tolerance=tolerance)


def test_a_shadow_counts_the_pairs_its_identifier_gave_up() -> None:
    """It reports the count of removed pairs of its identifier."""
    lms = LMSIdentifier(BANK, capacity=4)
    decaying = 0.5 + 0.4 * 0.9 ** np.arange(30) * (-1.0) ** np.arange(30)

    Shadowed(lms).run(decaying, decaying)

    assert lms.merged_pairs > 0
    assert Shadowed(lms).merged_pairs == lms.merged_pairs
