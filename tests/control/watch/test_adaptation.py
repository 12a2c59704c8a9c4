"""Tests of the watch of the adaptation, and of the detection of oscillation."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from piezod.control.faults.detection import Detection
from piezod.control.law.learned_models import LearnedBound, ModelDrift, ModelProof
from piezod.control.law.model import StageModel
from piezod.control.watch.adaptation import AdaptationWatch
from piezod.hysteresis import (
    LearnedModel,
    RLSIdentifier,
    Shadowed,
    StopForm,
    SurfaceForm,
    SurfaceIdentifier,
    even_thresholds,
    new_bank,
)
from piezod.hysteresis.normalisation import AffineRange
from tests.conftest import Reaction
from tests.control.fakes import MS
from tests.hysteresis.surfaces import Floats, drawn

POSITION_UM = AffineRange(0.0, 30.0)
BANK = new_bank(even_thresholds(5), even_thresholds(5))
MODEL = StageModel(StopForm(BANK), np.full(10, 0.02), AffineRange(0.0, 150.0), POSITION_UM, 0.0)

SURFACE = StageModel(SurfaceForm(), drawn(3), MODEL.drive_v, POSITION_UM, 0.0)


def learner() -> Shadowed:
    """Return the learning algorithm with the identified weights."""
    return Shadowed(RLSIdentifier(BANK, MODEL.weights))


def proof() -> ModelProof:
    """Return the comparison with the identified model, over ten cycles."""
    return ModelProof(LearnedModel(MODEL.weights.copy()), window_cycles=10, lag_cycles=3)


def run(
    watch: AdaptationWatch,
    position_um: Callable[[int], float],
    cycles: int,
    command_um: Callable[[int], float] = lambda _k: 15.0,
    *,
    closed: bool = True,
) -> list[Sequence[Detection]]:
    """Return the detections of each cycle."""
    return [
        watch.check(command_um(k), position_um(k), closed=closed, noise_um=0.02)
        for k in range(cycles)
    ]


def first(found: Sequence[Sequence[Detection]], fault: str) -> int:
    """Return the first cycle with a fault, -1 if there is none."""
    hits = (k for k, each in enumerate(found) if any(one.fault == fault for one in each))
    return next(hits, -1)


def wave(k: int, hz: float, amplitude_um: float) -> float:
    """Return an oscillation about 15 µm, in cycles of 1 ms."""
    return 15.0 + amplitude_um * math.sin(2e-3 * math.pi * hz * k)


def test_stage_that_follows_has_no_fault() -> None:
    """Noise at rest, a sine of 100 Hz with a lag, and a step that rings are healthy."""
    noise_um = np.random.default_rng(1).normal(0.0, 0.02, 3000).tolist()
    watch = AdaptationWatch(0, learner(), proof(), None, POSITION_UM, MS)
    found = run(watch, lambda k: 15.0 + noise_um[k], 3000)
    found += run(watch, lambda k: wave(k - 1, 100, 5.0), 3000, lambda k: wave(k, 100, 5.0))
    found += run(watch, lambda k: wave(k, 300, 5.0 * math.exp(-k / 40)), 3000)

    assert not any(found)


@pytest.mark.fault("D6")
@pytest.mark.parametrize("hz", [15.0, 60.0, 250.0])
def test_oscillation_is_detected_within_six_tenths_of_a_second(
    hz: float, reaction: Reaction
) -> None:
    """0.6 µm about a constant command is detected, with its amplitude, in a closed loop only."""
    watch = AdaptationWatch(0, learner(), proof(), None, POSITION_UM, MS)
    swinging = run(watch, lambda k: wave(k, hz, 0.6), 1000)
    opened = run(watch, lambda k: wave(k, hz, 0.6), 1000, closed=False)

    assert 400 < first(swinging, "D6") <= 600
    reaction("D6", cycles=first(swinging, "D6") + 1)
    assert swinging[-1][0].measured == pytest.approx(0.6, rel=0.1)
    assert not any(opened)


@pytest.mark.fault("D1")
@pytest.mark.parametrize(("every_s", "is_found"), [(10, True), (20, False)])
def test_third_return_to_the_last_good_model_is_detected(every_s: int, is_found: bool) -> None:
    """Three returns within thirty seconds are a fault; rarer ones are disturbances."""
    shadowed = learner()
    watch = AdaptationWatch(0, shadowed, proof(), None, POSITION_UM, 10 * MS)
    found = []
    for _ in range(3):
        shadowed.restored += 1
        found += run(watch, lambda _k: 15.0, 100 * every_s)

    assert first(found, "D1") == (200 * every_s if is_found else -1)


def test_returns_in_an_open_loop_are_no_fault() -> None:
    """The weights are not in use while the loop is open."""
    shadowed = learner()
    watch = AdaptationWatch(0, shadowed, proof(), None, POSITION_UM, MS)
    found = []
    for _ in range(10):
        shadowed.restored += 1
        found += run(watch, lambda _k: 15.0, 1000, closed=False)

    assert not any(found)


@pytest.mark.fault("D1")
@pytest.mark.parametrize(("error", "is_found"), [(0.02, True), (0.009, False)])
def test_stage_that_follows_worse_than_with_the_identified_model_is_detected(
    error: float, is_found: bool
) -> None:
    """A tracking error of 2 % of the range, where the identified model would make none."""
    judged = proof()
    watch = AdaptationWatch(0, learner(), judged, None, POSITION_UM, MS)
    worse = [judged.add(0.5, error, 0.0, LearnedModel(MODEL.weights.copy())) for _ in range(10)]
    found = run(watch, lambda _k: 15.0, 2)

    assert worse[-1] == is_found
    assert first(found, "D1") == (0 if is_found else -1)
    assert not found[1], "told once"
    assert not is_found or found[0][0][2:4] == pytest.approx((0.6, 0.3))


@pytest.mark.fault("D2")
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_weights_that_are_not_finite_are_detected_within_a_tenth_of_a_second(
    value: float, closed: bool
) -> None:
    """This holds whether the weights are in use or not, and is no distance from the model."""
    shadowed = learner()
    bound = LearnedBound(MODEL, shadowed, 0.05, MS)
    watch = AdaptationWatch(0, shadowed, proof(), bound, POSITION_UM, MS)
    shadowed.weights[3] = value

    found = []
    for _ in range(600):
        bound.update()
        found += run(watch, lambda _k: 15.0, 1, closed=closed)

    assert 0 < first(found, "D2") <= 100
    assert {detection.fault for each in found for detection in each} == {"D2"}


@pytest.mark.fault("D5")
@pytest.mark.fault("D11")
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize(
    ("weights", "offset", "told"),
    [
        (MODEL.weights, 0.02, []),
        (MODEL.weights, 0.03, ["D11"]),
        (MODEL.weights, 0.2, ["D11", "D5"]),
        (1.02 * SURFACE.weights, 0.0, []),
        (1.04 * SURFACE.weights, 0.0, ["D11"]),
        (1.8 * SURFACE.weights, 0.0, ["D11", "D5"]),
    ],
)
def test_learned_model_is_told_before_it_is_at_its_bound(
    weights: Floats, offset: float, told: Sequence[str], closed: bool, reaction: Reaction
) -> None:
    """Drives that differ by half of the bound of 5 % are a warning, the bound is the next one.

    An open loop learns, too: what it has learned can be saved.
    """
    stops = weights.size == MODEL.weights.size
    identified = MODEL if stops else SURFACE
    learned = learner() if stops else Shadowed(SurfaceIdentifier(SURFACE.weights))
    bound = LearnedBound(identified, learned, 0.05, MS)
    watch = AdaptationWatch(0, learned, proof(), bound, POSITION_UM, MS)
    learned.adopt(weights, offset=offset)
    found = []
    for _ in range(20_000):
        bound.update()
        found += run(watch, lambda _k: 15.0, 1, closed=closed)

    shown = dict.fromkeys(detection.fault.value for each in found for detection in each)
    assert list(shown) == list(told)
    for fault in told if "D5" in told else ():
        reaction(fault, cycles=first(found, fault) + 1)
    assert ModelDrift(identified).measure(learned) <= 0.05 + 1e-6
