"""Tests of whether a learned model is used: only while it predicts no worse than the first one."""

from collections.abc import Callable

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.control.guard import Limits
from piezod.control.law.axis import CompensatedAxis
from piezod.control.law.compensator import Compensator, DriveHistory
from piezod.control.law.identifier import Identifier, LearningGate
from piezod.control.law.learned_models import LearnedUse, ModelErrors, ModelProof
from piezod.control.law.trim import Trim
from piezod.control.reference.preview import ReferenceShaper
from piezod.devices.interface import Sample
from piezod.hysteresis import NO_CREEP, AffineRange, LearnedModel, NLMSIdentifier
from tests.conftest import Figure
from tests.control.fakes import MS
from tests.control.made_up import BANK, FORM, WEIGHTS, Array, MadeUpStage, wander

WINDOW = 500
NOISE = 0.002
RANGE = AffineRange(0.0, 1.0)
SECONDS = 16.0


def windows_to_change(subject: LearnedUse, learned: float, first: float) -> int | None:
    """Return after how many windows of noisy errors of this rms the use changes; None if never."""
    rng = np.random.default_rng(1)
    for window in range(1, 41):
        for k, noise in enumerate(rng.normal(0.0, NOISE, WINDOW).tolist()):
            swings = np.sqrt(2.0) * np.sin(0.05 * k)
            if subject.add(noise + learned * swings, noise + first * swings, 0.0, 0.0, 0.0):
                return window
    return None


@pytest.mark.parametrize(
    ("learned", "first", "changes"),
    [
        (0.001, 0.0, True),
        (0.002, 0.0015, True),
        (0.001, 0.001, False),
        (0.0, 0.001, False),
        (1.5e-4, 0.0, False),  # below what makes a difference
    ],
)
def test_worse_model_is_noticed_in_noise(learned: float, first: float, changes: bool) -> None:
    """Its error may be half of the noise, which both models have."""
    assert (windows_to_change(LearnedUse(WINDOW), learned, first) is not None) == changes


def test_model_that_has_become_better_is_used_again() -> None:
    """It has learned on meanwhile, or the stage has changed."""
    subject = LearnedUse(WINDOW)
    assert windows_to_change(subject, 0.001, 0.0)
    assert not subject.used

    assert windows_to_change(subject, 0.0, 0.002)
    assert subject.used
    assert not windows_to_change(subject, 0.0, 0.002)


def test_errors_that_are_not_finite_do_not_count() -> None:
    """They are those of samples from which nothing was learned."""
    subject = LearnedUse(WINDOW)
    for _ in range(10 * WINDOW):
        assert not subject.add(float("nan"), 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("learned", "of_lag", "of_noise", "used"),
    [
        (0.004, 0.003**2, 0.0, True),
        (0.002, 0.003**2, 0.0, False),
        (0.0008, 0.0, 0.002**2, True),
        (0.0003, 0.0, 0.002**2, False),
        (0.0006, 0.0, 0.002**2, True),  # of large noise less is learned
        (1e-4, 1.9e-4**2, 0.0, True),  # below what makes a difference
    ],
)
def test_difference_that_lag_and_noise_explain_is_not_used(
    learned: float, of_lag: float, of_noise: float, used: bool
) -> None:
    """Even if it makes the measured error zero: the samples may show what the stage does not do."""
    subject, rng = LearnedUse(WINDOW, 0.1), np.random.default_rng(1)
    for noise in rng.normal(0.0, NOISE, 4 * WINDOW).tolist():
        subject.add(noise, noise + learned, of_lag, of_noise, 0.0)

    assert subject.used == used


def test_model_that_differs_by_more_after_a_while_is_used() -> None:
    """Clearly more: near the limit it would come and go."""
    subject = LearnedUse(WINDOW)
    changes = [
        subject.add(0.0, difference, 0.003**2, 0.0, 0.0)
        for difference in np.linspace(0, 0.02, 9000)
    ]

    assert sum(changes) == 2
    assert subject.used


@pytest.mark.parametrize(
    ("lag_cycles", "beside", "used"),
    [(0.4, 0.0, False), (0.7, 0.0, True), (0.4, 0.01, True), (-0.4, 0.0, False)],
)
def test_lag_that_samples_do_not_tell_makes_no_difference(
    lag_cycles: float, beside: float, used: bool
) -> None:
    """In addition to it, another difference counts."""
    subject = LearnedUse(WINDOW, 0.0, 0.5)
    for k in range(4 * WINDOW):
        position, change = 0.3 * np.sin(0.05 * k), 0.015 * np.cos(0.05 * k)
        difference = lag_cycles * change + beside * position
        subject.add(0.0, difference, 1e-6, 0.0, change)

    assert subject.used == used


def test_lag_changes_the_displacement_with_speed_and_its_change() -> None:
    """A tenth of the way of a cycle, and the whole change of that way."""
    adaptation = NLMSIdentifier(BANK, gain=0.5)
    adaptation.adopt(WEIGHTS)
    errors = ModelErrors(FORM, LearnedModel(WEIGHTS.copy()), adaptation, None)
    of_lag = []
    for drive in (0.5, 0.5, 0.51, 0.52, 0.51):
        errors.follow(drive, 0.5, 0.0)
        of_lag.append(errors.of_lag)

    assert of_lag == pytest.approx([0.0, 0.0, 1.01e-4, 1e-6, 4.01e-4])


def test_lag_that_a_response_tells_explains_nothing() -> None:
    """All that a fast sine teaches is of the model."""
    adaptation = NLMSIdentifier(BANK, gain=0.5)
    adaptation.adopt(WEIGHTS)
    first = LearnedModel(WEIGHTS.copy())
    errors = ModelErrors(FORM, first, adaptation, None, lag_known=True)
    for drive in (0.5, 0.52, 0.56):
        errors.follow(drive, 0.5, 0.0)

    assert errors.of_lag == 0.0
    assert errors.change == pytest.approx(0.04)


def test_sample_that_is_told_again_is_no_stop_of_the_drive() -> None:
    """The lag behind a slow sensor is that of its own samples."""
    adaptation = NLMSIdentifier(BANK, gain=0.5)
    adaptation.adopt(WEIGHTS)
    errors = ModelErrors(FORM, LearnedModel(WEIGHTS.copy()), adaptation, None)
    for drive in (0.5, 0.52, 0.54, 0.56):
        for _ in range(2):
            errors.follow(drive, drive - 0.1, 0.0)

    assert errors.of_lag == pytest.approx(4e-6)


def axis_of(reference: Callable[[float], float], mode: Mode) -> CompensatedAxis:
    """Return an axis that knows its stage, with an identifier that forgets."""
    history, adaptation = DriveHistory(0.0, entries=8), NLMSIdentifier(BANK, gain=0.5)
    adaptation.adopt(WEIGHTS)
    proof = ModelProof(LearnedModel(WEIGHTS.copy()), window_cycles=WINDOW, lag_cycles=3)
    return CompensatedAxis(
        reference_um=reference,
        drive_v=RANGE,
        position_um=RANGE,
        compensator=Compensator(FORM, WEIGHTS, mode=mode, fade_cycles=100),
        identifier=Identifier(
            adaptation,
            RANGE,
            RANGE,
            history,
            0,
            MS,
            None,
            LearningGate(MS),
            errors=ModelErrors(FORM, proof.first, adaptation, None),
        ),
        history=history,
        limits=Limits(0.0, 1.0, 1e9),
        in_force_v=0.0,
        start_ns=0,
        period_ns=MS,
        delay_ns=0,
        sensor_delay_ns=0,
        proof=proof,
        feedbacks={Mode.TRIMMED: Trim(50.0, 1e-3, 0.05, 100)},
        shaper=ReferenceShaper(1e-3),
    )


def run(mode: Mode) -> tuple[Array, Array]:
    """Return drives and errors of an axis whose samples have noise and gaps, shape (n,) each."""
    commands, rng = wander(SECONDS), np.random.default_rng(3)

    def reference(t_s: float) -> float:
        return float(commands[min(max(round(1e3 * t_s), 0), commands.size - 1)])

    axis, stage, in_force = axis_of(reference, mode), MadeUpStage(NO_CREEP), 0.0
    noise, missing = rng.normal(0.0, NOISE, commands.size), rng.random(commands.size) < 0.2
    drives, errors = np.empty(commands.size), np.empty(commands.size)
    for k in range(commands.size):
        position = stage.step(in_force)
        drives[k], errors[k] = in_force, position - commands[k]
        sample = Sample(k * MS, position + noise[k], valid=not missing[k])
        output = axis.update(k * MS, sample)
        axis.applied(output.drive_v)
        in_force = output.drive_v
    return drives, errors


def test_adaptive_is_no_worse_than_feedforward_with_noise_and_gaps(figure: Figure) -> None:
    """What noise has taught is not used for long, and is given up without a jump."""
    (_, without), (drives, learning) = run(Mode.FEEDFORWARD), run(Mode.ADAPTIVE)
    late = slice(int(500 * SECONDS), None)
    rms_pct = [100.0 * float(np.sqrt(np.mean(each[late] ** 2))) for each in (without, learning)]

    figure(f"rms %, noise of {100 * NOISE:g} %, 20 % missing: feedforward, adaptive {rms_pct}")
    assert rms_pct[1] < rms_pct[0] + 0.02
    assert np.abs(np.diff(drives[100:])).max() < 0.01
