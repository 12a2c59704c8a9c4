"""The compensator on a stage that creeps: the displacement stays put, the drive moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.control.law.creep import CreepState
from tests.control.made_up import BANK, CREEP, WEIGHTS, Array, MadeUpStage

RELAXED = CreepState(CREEP, np.zeros(3), 0.0, 0.0)
WINDOWS = st.one_of(
    st.just((0.0, 1.0)), st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted).map(tuple)
)
CYCLES = st.lists(
    st.tuples(st.floats(0.1, 0.9), WINDOWS, st.booleans(), st.sampled_from(Mode)), max_size=40
)
"""Command, window, whether the write is taken, mode."""


def compensator(creep: CreepState = RELAXED) -> Compensator:
    """Return a compensator of the made-up stage, which switches at once."""
    return Compensator(BANK, WEIGHTS, mode=Mode.FEEDFORWARD, fade_cycles=1, creep=creep)


def held(one: Compensator, stage: MadeUpStage, commands: Array) -> tuple[Array, Array]:
    """Return drives and displacements for commands, shape (n,) each."""
    drives = np.array([one.step(x, 0.0, 1.0, WEIGHTS) for x in commands])
    return drives, np.array([stage.step(drive) for drive in drives])


def test_displacement_stays_put_after_a_step() -> None:
    """For ten seconds the drive goes back by as much as creeps; the stage does not move."""
    step = np.concatenate((np.zeros(10), np.full(10_000, 0.6)))

    drives, positions = held(compensator(), MadeUpStage(), step)

    np.testing.assert_allclose(positions, step, rtol=0, atol=1e-9)
    assert drives[10] - drives[-1] > 0.02
    assert np.all(np.diff(drives[10:]) < 0.0)


def test_without_creep_in_the_model_the_stage_moves_on() -> None:
    """The test above is about something."""
    step = np.full(10_000, 0.6)
    plain = Compensator(BANK, WEIGHTS, mode=Mode.FEEDFORWARD, fade_cycles=1)

    drives, positions = held(plain, MadeUpStage(), step)

    assert np.ptp(drives) == 0.0
    assert positions[-1] - positions[0] > 0.02


def test_creep_before_the_zero_goes_on() -> None:
    """A stage that was zeroed while it crept is held where it is, and where it is sent."""
    lags = np.array([0.1, 0.3, 0.5])
    zeroed = float(CREEP.weights @ lags)
    commands = np.concatenate((np.full(500, 0.2), np.full(3000, 0.7)))

    one, stage = compensator(CreepState(CREEP, lags, zeroed, 0.0)), MadeUpStage(lags=lags)
    _, positions = held(one, stage, commands)

    np.testing.assert_allclose(positions - zeroed, commands, rtol=0, atol=1e-9)


def test_the_state_it_starts_from_stays_as_it_was() -> None:
    """Others go on from it."""
    lags = np.array([0.1, 0.3, 0.5])

    held(compensator(CreepState(CREEP, lags, 0.0, 0.0)), MadeUpStage(), np.full(100, 0.5))

    assert lags.tolist() == [0.1, 0.3, 0.5]


def test_rest_above_the_lower_end_is_where_it_starts() -> None:
    """The lags of a stage that rests there are there too, and nothing moves."""
    lags = np.full(3, 0.4)
    zeroed = float(CREEP.weights @ lags)
    one = compensator(CreepState(CREEP, lags, zeroed, 0.4))

    drives = [one.step(0.4, 0.0, 1.0, WEIGHTS) for _ in range(1000)]
    lost = compensator(CreepState(CREEP, lags, zeroed, 0.4))

    assert np.ptp(drives) < 1e-12
    assert lost.step(float("nan"), 0.0, 1.0, WEIGHTS) == pytest.approx(drives[0])


@given(cycles=CYCLES, after=st.lists(st.floats(0.1, 0.9), min_size=1, max_size=10))
def test_creep_follows_what_was_applied(
    cycles: list[tuple[float, tuple[float, float], bool, Mode]], after: list[float]
) -> None:
    """After limits, refused writes and other modes, the stage goes where it is sent."""
    one, stage, in_force = compensator(), MadeUpStage(), 0.0
    for command, (low, high), taken, mode in cycles:
        one.switch(mode)
        drive = one.step(command, low, high, WEIGHTS)
        if taken:
            in_force = drive
        else:
            one.discard_last()
        stage.step(in_force)

    one.switch(Mode.FEEDFORWARD)
    _, positions = held(one, stage, np.array(after))

    np.testing.assert_allclose(positions, after, rtol=0, atol=1e-9)


@given(commands=st.lists(st.floats(0.1, 0.9), min_size=2, max_size=20))
def test_a_refused_command_leaves_no_trace(commands: list[float]) -> None:
    """Refused or never asked for: what comes next is the same."""
    refused, spared = compensator(), compensator()
    for command in commands:
        for one in (refused, spared):
            one.step(command, 0.0, 1.0, WEIGHTS)
        for one, asked in ((refused, 0.95), (spared, 0.05)):
            one.step(asked, 0.0, 1.0, WEIGHTS)
            one.discard_last()

    assert refused.step(0.5, 0.0, 1.0, WEIGHTS) == spared.step(0.5, 0.0, 1.0, WEIGHTS)
