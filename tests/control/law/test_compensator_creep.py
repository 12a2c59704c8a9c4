"""Tests of the compensator on a stage that creeps: the position stays, the drive moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.control.law.creep import CreepState
from tests.control.made_up import CREEP, LINE, Array, Kind, MadeUpStage, wander

RELAXED = CreepState(CREEP, np.zeros(3), 0.0, 0.0)
WINDOWS = st.one_of(
    st.just((0.0, 1.0)), st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted).map(tuple)
)
CYCLES = st.lists(
    st.tuples(st.floats(0.1, 0.9), WINDOWS, st.booleans(), st.sampled_from(Mode)), max_size=40
)
"""Command, window, whether the write is taken, mode."""


def compensator(kind: Kind, creep: CreepState = RELAXED) -> Compensator:
    """Return a compensator of a made-up stage that creeps, without a fade."""
    return kind.compensator(Mode.FEEDFORWARD, creep=creep)


def driven(
    kind: Kind, subject: Compensator, stage: MadeUpStage, commands: Array
) -> tuple[Array, Array]:
    """Return drives and positions for commands, shape (n,) each."""
    drives = np.array([subject.step(x, 0.0, 1.0, kind.weights) for x in commands])
    return drives, np.array([stage.step(drive) for drive in drives])


def test_position_stays_after_a_step(kind: Kind) -> None:
    """For ten seconds the drive moves back as much as the stage creeps."""
    step = np.concatenate((np.zeros(10), np.full(10_000, 0.6)))

    drives, positions = driven(kind, compensator(kind), MadeUpStage(kind=kind), step)

    np.testing.assert_allclose(positions, step, rtol=0, atol=1e-9)
    assert drives[10] - drives[-1] > 0.02
    assert np.all(np.diff(drives[10:]) < 0.0)


def test_stage_creeps_without_creep_in_the_model(kind: Kind) -> None:
    """Without compensation the stage of the test above creeps by more than 2 %."""
    step = np.full(10_000, 0.6)
    plain = kind.compensator(Mode.FEEDFORWARD)

    drives, positions = driven(kind, plain, MadeUpStage(kind=kind), step)

    assert np.ptp(drives) < 1e-12
    assert positions[-1] - positions[0] > 0.02


def test_creep_before_the_zero_is_compensated(kind: Kind) -> None:
    """A stage that was zeroed while it crept stays at its commands."""
    lags = np.array([0.1, 0.3, 0.5])
    zeroed = float(CREEP.weights @ lags)
    commands = np.concatenate((np.full(500, 0.2), np.full(3000, 0.7)))

    subject, stage = (
        compensator(kind, CreepState(CREEP, lags, zeroed, 0.0)),
        MadeUpStage(lags=lags, kind=kind),
    )
    _, positions = driven(kind, subject, stage, commands)

    np.testing.assert_allclose(positions - zeroed, commands, rtol=0, atol=1e-9)


def test_initial_state_is_not_changed(kind: Kind) -> None:
    """Other objects continue from the same state."""
    lags = np.array([0.1, 0.3, 0.5])

    driven(
        kind,
        compensator(kind, CreepState(CREEP, lags, 0.0, 0.0)),
        MadeUpStage(kind=kind),
        np.full(100, 0.5),
    )

    assert lags.tolist() == [0.1, 0.3, 0.5]


def test_compensator_starts_at_rest_above_the_lower_end(kind: Kind) -> None:
    """The lags of a stage that rests there are there, too, and nothing moves."""
    lags = np.full(3, 0.4)
    zeroed = float(CREEP.weights @ lags)
    subject = compensator(kind, CreepState(CREEP, lags, zeroed, 0.4))

    drives = [subject.step(0.4, 0.0, 1.0, kind.weights) for _ in range(1000)]
    without_command = compensator(kind, CreepState(CREEP, lags, zeroed, 0.4))

    assert np.ptp(drives) < 1e-12
    assert without_command.step(float("nan"), 0.0, 1.0, kind.weights) == pytest.approx(drives[0])


@given(cycles=CYCLES, after=st.lists(st.floats(0.1, 0.9), min_size=1, max_size=10))
def test_creep_follows_the_applied_voltage(
    kind: Kind, cycles: list[tuple[float, tuple[float, float], bool, Mode]], after: list[float]
) -> None:
    """After limits, refused writes and other modes the stage still follows its commands."""
    subject, stage, in_force = compensator(kind), MadeUpStage(kind=kind), 0.0
    for command, (low, high), taken, mode in cycles:
        subject.switch(mode)
        drive = subject.step(command, low, high, kind.weights)
        if taken:
            in_force = drive
        else:
            subject.discard_last()
        stage.step(in_force)

    subject.switch(Mode.FEEDFORWARD)
    _, positions = driven(kind, subject, stage, np.array(after))

    np.testing.assert_allclose(positions, after, rtol=0, atol=1e-9)


@given(commands=st.lists(st.floats(0.1, 0.9), min_size=2, max_size=20))
def test_refused_drive_leaves_no_trace(kind: Kind, commands: list[float]) -> None:
    """After a refused drive the next drive does not depend on it."""
    refused, reference = compensator(kind), compensator(kind)
    for command in commands:
        for subject in (refused, reference):
            subject.step(command, 0.0, 1.0, kind.weights)
        for subject, asked in ((refused, 0.95), (reference, 0.05)):
            subject.step(asked, 0.0, 1.0, kind.weights)
            subject.discard_last()

    assert refused.step(0.5, 0.0, 1.0, kind.weights) == reference.step(0.5, 0.0, 1.0, kind.weights)


@given(cycles=CYCLES)
def test_expected_displacement_is_that_of_the_stage(
    kind: Kind, cycles: list[tuple[float, tuple[float, float], bool, Mode]]
) -> None:
    """After limits, refused writes and other modes the compensator knows where the stage is."""
    subject, stage, in_force = compensator(kind), MadeUpStage(kind=kind), 0.0
    for command, (low, high), taken, mode in cycles:
        subject.switch(mode)
        drive = subject.step(command, low, high, kind.weights)
        if taken:
            in_force = drive
        else:
            subject.discard_last()
        position = stage.step(in_force)

        assert subject.expected == pytest.approx(position, abs=1e-9)


@pytest.mark.parametrize("mode", list(Mode))
def test_holding_command_keeps_the_drive(kind: Kind, mode: Mode) -> None:
    """The command for a drive in force makes this drive again."""
    subject = kind.compensator(mode)
    last = kind.drives(subject, [0.2, 0.8, 0.35])[-1]

    command = subject.holding_command(last, 0.0)

    assert subject.step(command, 0.0, 1.0, kind.weights) == pytest.approx(last, abs=1e-12)


def test_displacement_at_a_limited_drive_is_that_of_the_stage(kind: Kind) -> None:
    """A drive that the window limits moves the stage only so far, and `expected` says so."""
    subject, stage = compensator(kind), MadeUpStage(kind=kind)

    drive = subject.step(0.9, 0.0, 0.4, kind.weights)
    position = stage.step(drive)

    assert drive == 0.4
    assert subject.limited_direction == 1
    assert subject.expected == pytest.approx(position, abs=1e-12)
    assert subject.position < 0.5


def test_what_is_left_at_rest_counts_as_zero(kind: Kind) -> None:
    """After a rest the stage keeps to its commands from there, whatever was left there."""
    subject, stage = compensator(kind), MadeUpStage(kind=kind)
    driven(kind, subject, stage, 0.3 + 0.2 * wander(2.0))
    for _ in range(100):
        zero = stage.step(subject.step(0.0, 0.0, 0.0, kind.weights))
    subject.zero(0.0)

    commands = wander(2.0)
    _, positions = driven(kind, subject, stage, commands)

    assert abs(zero) > 1e-3
    np.testing.assert_allclose(positions - zero, commands, rtol=0, atol=1e-9)


def test_path_that_is_left_at_a_rest_inside_the_range_counts_as_zero() -> None:
    """Only what it has beyond a relaxed stage counts: the rest contains all else."""
    rest, stage = 0.4, MadeUpStage(kind=LINE)
    nominal = LINE.form.positions_at(LINE.weights, np.array([rest])).item()
    lags = np.full(3, nominal)
    zeroed = float(CREEP.weights @ lags)
    stage.step(rest)
    stage.lags[:] = lags
    subject = compensator(LINE, CreepState(CREEP, lags, zeroed, nominal))
    assert subject.step(float("nan"), 0.0, 1.0, LINE.weights) == pytest.approx(rest, abs=1e-12)
    stage.step(rest)

    for commands in (0.3 + 0.2 * wander(2.0), wander(2.0)):
        _, positions = driven(LINE, subject, stage, commands)
        np.testing.assert_allclose(positions - zeroed, commands, rtol=0, atol=1e-9)
        before = zeroed
        for _ in range(100):
            zeroed = stage.step(subject.step(0.0, rest, rest, LINE.weights)) - nominal
        subject.zero(nominal)

    assert abs(zeroed - before) > 1e-3
