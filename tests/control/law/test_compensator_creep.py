"""Tests of the compensator on a stage that creeps: the position stays, the drive moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.control.law.creep import CreepState
from tests.control.made_up import CREEP, FORM, WEIGHTS, Array, MadeUpStage

RELAXED = CreepState(CREEP, np.zeros(3), 0.0, 0.0)
WINDOWS = st.one_of(
    st.just((0.0, 1.0)), st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted).map(tuple)
)
CYCLES = st.lists(
    st.tuples(st.floats(0.1, 0.9), WINDOWS, st.booleans(), st.sampled_from(Mode)), max_size=40
)
"""Command, window, whether the write is taken, mode."""


def compensator(creep: CreepState = RELAXED) -> Compensator:
    """Return a compensator of the made-up stage, without a fade."""
    return Compensator(FORM, WEIGHTS, mode=Mode.FEEDFORWARD, fade_cycles=1, creep=creep)


def driven(subject: Compensator, stage: MadeUpStage, commands: Array) -> tuple[Array, Array]:
    """Return drives and positions for commands, shape (n,) each."""
    drives = np.array([subject.step(x, 0.0, 1.0, WEIGHTS) for x in commands])
    return drives, np.array([stage.step(drive) for drive in drives])


def test_position_stays_after_a_step() -> None:
    """For ten seconds the drive moves back as much as the stage creeps."""
    step = np.concatenate((np.zeros(10), np.full(10_000, 0.6)))

    drives, positions = driven(compensator(), MadeUpStage(), step)

    np.testing.assert_allclose(positions, step, rtol=0, atol=1e-9)
    assert drives[10] - drives[-1] > 0.02
    assert np.all(np.diff(drives[10:]) < 0.0)


def test_stage_creeps_without_creep_in_the_model() -> None:
    """Without compensation the stage of the test above creeps by more than 2 %."""
    step = np.full(10_000, 0.6)
    plain = Compensator(FORM, WEIGHTS, mode=Mode.FEEDFORWARD, fade_cycles=1)

    drives, positions = driven(plain, MadeUpStage(), step)

    assert np.ptp(drives) == 0.0
    assert positions[-1] - positions[0] > 0.02


def test_creep_before_the_zero_is_compensated() -> None:
    """A stage that was zeroed while it crept stays at its commands."""
    lags = np.array([0.1, 0.3, 0.5])
    zeroed = float(CREEP.weights @ lags)
    commands = np.concatenate((np.full(500, 0.2), np.full(3000, 0.7)))

    subject, stage = compensator(CreepState(CREEP, lags, zeroed, 0.0)), MadeUpStage(lags=lags)
    _, positions = driven(subject, stage, commands)

    np.testing.assert_allclose(positions - zeroed, commands, rtol=0, atol=1e-9)


def test_initial_state_is_not_changed() -> None:
    """Other objects continue from the same state."""
    lags = np.array([0.1, 0.3, 0.5])

    driven(compensator(CreepState(CREEP, lags, 0.0, 0.0)), MadeUpStage(), np.full(100, 0.5))

    assert lags.tolist() == [0.1, 0.3, 0.5]


def test_compensator_starts_at_rest_above_the_lower_end() -> None:
    """The lags of a stage that rests there are there, too, and nothing moves."""
    lags = np.full(3, 0.4)
    zeroed = float(CREEP.weights @ lags)
    subject = compensator(CreepState(CREEP, lags, zeroed, 0.4))

    drives = [subject.step(0.4, 0.0, 1.0, WEIGHTS) for _ in range(1000)]
    without_command = compensator(CreepState(CREEP, lags, zeroed, 0.4))

    assert np.ptp(drives) < 1e-12
    assert without_command.step(float("nan"), 0.0, 1.0, WEIGHTS) == pytest.approx(drives[0])


@given(cycles=CYCLES, after=st.lists(st.floats(0.1, 0.9), min_size=1, max_size=10))
def test_creep_follows_the_applied_voltage(
    cycles: list[tuple[float, tuple[float, float], bool, Mode]], after: list[float]
) -> None:
    """After limits, refused writes and other modes the stage still follows its commands."""
    subject, stage, in_force = compensator(), MadeUpStage(), 0.0
    for command, (low, high), taken, mode in cycles:
        subject.switch(mode)
        drive = subject.step(command, low, high, WEIGHTS)
        if taken:
            in_force = drive
        else:
            subject.discard_last()
        stage.step(in_force)

    subject.switch(Mode.FEEDFORWARD)
    _, positions = driven(subject, stage, np.array(after))

    np.testing.assert_allclose(positions, after, rtol=0, atol=1e-9)


@given(commands=st.lists(st.floats(0.1, 0.9), min_size=2, max_size=20))
def test_refused_drive_leaves_no_trace(commands: list[float]) -> None:
    """After a refused drive the next drive does not depend on it."""
    refused, reference = compensator(), compensator()
    for command in commands:
        for subject in (refused, reference):
            subject.step(command, 0.0, 1.0, WEIGHTS)
        for subject, asked in ((refused, 0.95), (reference, 0.05)):
            subject.step(asked, 0.0, 1.0, WEIGHTS)
            subject.discard_last()

    assert refused.step(0.5, 0.0, 1.0, WEIGHTS) == reference.step(0.5, 0.0, 1.0, WEIGHTS)
