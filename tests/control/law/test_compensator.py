"""Tests of the compensator: the drive in each mode, and the memory of the applied voltage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from tests.control.made_up import WEIGHTS, Kind, compensator, drives, inverse, sine

COMMANDS = st.lists(st.floats(0, 1), min_size=1, max_size=40)
WINDOWS = st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=40)


@given(commands=COMMANDS)
def test_uncompensated_drive_is_proportional_to_the_command(
    kind: Kind, commands: list[float]
) -> None:
    """For any model the normalised drive is the normalised command."""
    np.testing.assert_allclose(
        kind.drives(kind.compensator(Mode.UNCOMPENSATED), commands), commands, rtol=0, atol=1e-15
    )


@given(commands=COMMANDS)
def test_feedforward_drive_is_that_of_the_inverse_model(kind: Kind, commands: list[float]) -> None:
    """The operators give the same drive as the closed form."""
    np.testing.assert_allclose(
        kind.drives(kind.compensator(Mode.FEEDFORWARD), commands),
        kind.drives_for(commands),
        rtol=0,
        atol=1e-12,
    )


@given(commands=COMMANDS)
def test_adaptive_drive_with_the_frozen_weights_is_feedforward(
    kind: Kind, commands: list[float]
) -> None:
    """Following an identifier that learns nothing changes nothing, to the bit."""
    assert kind.drives(kind.compensator(Mode.ADAPTIVE), commands) == kind.drives(
        kind.compensator(Mode.FEEDFORWARD), commands
    )


@pytest.mark.parametrize(
    ("follows", "base"), [(False, Mode.FEEDFORWARD), (True, Mode.ADAPTIVE)], ids=["fixed", "adapts"]
)
def test_trimmed_drive_is_that_of_its_base(kind: Kind, follows: bool, base: Mode) -> None:
    """Without a trim both drives are the same to the bit."""
    learning = frozenset({Mode.ADAPTIVE, Mode.TRIMMED} if follows else {Mode.ADAPTIVE})
    trimmed = Compensator(
        kind.form, kind.weights, mode=Mode.TRIMMED, fade_cycles=1, learning=learning
    )

    assert kind.drives(trimmed, sine(2), kind.other) == kind.drives(
        kind.compensator(base), sine(2), kind.other
    )


def test_trim_is_added_to_the_displacement_that_is_compensated(kind: Kind) -> None:
    """The trim passes through the inverse model like the command."""
    subject, trims = kind.compensator(Mode.TRIMMED), 0.05 * np.sin(np.arange(2000) / 300)

    trimmed = [
        subject.step(x, 0.0, 1.0, np.zeros_like(kind.weights), trim=t)
        for x, t in zip(sine(2), trims, strict=True)
    ]

    np.testing.assert_allclose(trimmed, kind.drives_for(sine(2) + trims), rtol=0, atol=1e-12)


def test_offset_is_followed_in_adaptive_mode_only(kind: Kind) -> None:
    """The offset is subtracted from the command; it stays when the mode is left."""
    subject = kind.compensator(Mode.FEEDFORWARD)
    assert (
        subject.step(0.5, 0.0, 1.0, kind.weights, offset=0.1)
        == kind.drives(kind.compensator(Mode.FEEDFORWARD), [0.5]).pop()
    )

    subject.switch(Mode.ADAPTIVE)
    for _ in range(200):
        subject.step(0.5, 0.0, 1.0, kind.weights, offset=0.1)
    subject.switch(Mode.FEEDFORWARD)
    drifted = subject.step(0.7, 0.0, 1.0, kind.weights, offset=-0.1)

    assert drifted == pytest.approx(kind.drives_for([0.5, 0.4, 0.6])[-1], abs=1e-12)


def test_scale_is_followed_in_adaptive_mode_only() -> None:
    """A stage that moves farther gets a smaller command; the offset counts in addition."""
    subject = compensator(Mode.FEEDFORWARD)
    fixed = subject.step(0.5, 0.0, 1.0, WEIGHTS, scale=-0.1)
    assert fixed == drives(compensator(Mode.FEEDFORWARD), [0.5]).pop()

    subject.switch(Mode.ADAPTIVE)
    for _ in range(200):
        subject.step(0.5, 0.0, 1.0, WEIGHTS, offset=0.05, scale=-0.1)
    subject.switch(Mode.FEEDFORWARD)
    scaled = subject.step(0.8, 0.0, 1.0, WEIGHTS, scale=0.2)

    assert scaled == pytest.approx(inverse().run([0.5, 0.4, 0.67])[-1], abs=1e-12)


def test_scale_beyond_the_range_stops_at_its_end() -> None:
    """A stage that moves less cannot reach the top: the drive stays in the model's range."""
    subject = compensator(Mode.ADAPTIVE)

    top = [subject.step(0.95, 0.0, 2.0, WEIGHTS, scale=0.1) for _ in range(200)][-1]

    assert top == pytest.approx(1.0, abs=1e-12)
    assert (subject.limited_direction, subject.limited) == (1, False)


def test_limited_direction_is_the_one_without_room(kind: Kind) -> None:
    """It is set if the drive is limited, or else the displacement."""
    subject = kind.compensator(Mode.FEEDFORWARD)
    seen = []
    for command, low, high, trim in [
        (0.5, 0.0, 1.0, 0.0),
        (0.9, 0.0, 0.6, 0.0),  # drive too low
        (0.1, 0.4, 1.0, 0.0),  # drive too high
        (0.0, 0.0, 1.0, -0.5),  # displacement at its lower end
        (1.0, 0.0, 1.0, 0.5),  # and at its upper one
        (0.5, 0.0, 1.0, 0.01),
    ]:
        subject.step(command, low, high, kind.weights, trim=trim)
        seen.append((subject.limited_direction, subject.limited))

    assert seen == [(0, False), (1, True), (-1, True), (-1, False), (1, False), (0, False)]


def test_adaptive_drive_follows_the_identifier(kind: Kind) -> None:
    """The weights in use approach those of the identifier, and stay when the mode is left."""
    subject = kind.compensator(Mode.ADAPTIVE)
    kind.drives(subject, np.full(200, 0.5), kind.other)
    np.testing.assert_allclose(subject.weights, kind.other, atol=1e-12)

    subject.switch(Mode.FEEDFORWARD)
    kind.drives(subject, np.full(200, 0.5), np.zeros_like(kind.weights))

    np.testing.assert_allclose(subject.weights, kind.other, atol=1e-12)


@pytest.mark.parametrize("mode", [Mode.UNCOMPENSATED, Mode.FEEDFORWARD])
def test_weights_are_fixed_in_the_other_modes(kind: Kind, mode: Mode) -> None:
    """The weights of the identifier do not matter."""
    subject = kind.compensator(mode)

    kind.drives(subject, sine(2), kind.other)

    assert subject.weights.tolist() == kind.weights.tolist()


@given(windows=WINDOWS, commands=COMMANDS, mode=st.sampled_from(list(Mode)))
def test_drive_never_leaves_the_window(
    kind: Kind, windows: list[tuple[float, float]], commands: list[float], mode: Mode
) -> None:
    """The limits hold in every mode."""
    subject = kind.compensator(mode)
    for command, ends in zip(commands, windows, strict=False):
        low, high = sorted(ends)

        assert low <= subject.step(command, low, high, kind.other) <= high


@pytest.mark.parametrize("mode", list(Mode))
@given(windows=WINDOWS, commands=COMMANDS, after=COMMANDS)
def test_memory_advances_with_the_applied_voltage(
    kind: Kind,
    mode: Mode,
    windows: list[tuple[float, float]],
    commands: list[float],
    after: list[float],
) -> None:
    """After limited drives the memory is that of the applied voltages."""
    subject, stage, positions = kind.compensator(mode), kind.form.stage(kind.weights), []
    for command, ends in zip(commands, windows, strict=False):
        low, high = sorted(ends)
        applied = subject.step(command, low, high, kind.weights)
        positions.append(stage.step(applied))

    subject.switch(Mode.FEEDFORWARD)

    expected = kind.drives_for([*positions, *after])[len(positions) :]
    np.testing.assert_allclose(kind.drives(subject, after), expected, rtol=0, atol=1e-9)


def test_drive_beyond_the_range_of_the_model_leaves_the_memory_at_its_end(kind: Kind) -> None:
    """If the limits allow more than the model covers, the memory is at 0 or at 1."""
    subject = kind.compensator(Mode.FEEDFORWARD)

    assert subject.step(0.5, 1.2, 1.3, kind.weights) == 1.2
    assert subject.step(0.5, -0.2, -0.1, kind.weights) == -0.1

    after = [0.3, 0.2, 0.7]
    expected = kind.drives_for([1.0, 0.0, *after])[2:]
    # Loops that do not close end near 0 and 1.
    np.testing.assert_allclose(kind.drives(subject, after), expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("mode", list(Mode))
def test_command_that_is_not_a_number_holds_the_drive(kind: Kind, mode: Mode) -> None:
    """NaN moves nothing, and the next command is followed as if NaN had not come."""
    subject, spared = kind.compensator(mode), kind.compensator(mode)
    last = kind.drives(subject, [0.2, 0.7, 0.4])[-1]
    kind.drives(spared, [0.2, 0.7, 0.4])

    assert subject.step(float("nan"), 0.0, 1.0, kind.weights) == pytest.approx(last, abs=1e-12)
    np.testing.assert_allclose(
        kind.drives(subject, [0.5, 0.3]), kind.drives(spared, [0.5, 0.3]), atol=1e-12
    )


def test_command_outside_the_range_is_clamped(kind: Kind) -> None:
    """A command outside the model's displacement is its nearest end."""
    assert kind.drives(kind.compensator(Mode.FEEDFORWARD), [0.5, 1.7, -3.0]) == kind.drives(
        kind.compensator(Mode.FEEDFORWARD), [0.5, 1.0, 0.0]
    )


@pytest.mark.parametrize("mode", list(Mode))
def test_compensator_starts_in_its_mode(kind: Kind, mode: Mode) -> None:
    """There is no fade at the start."""
    slow, quick = kind.compensator(mode, fade_cycles=1000), kind.compensator(mode)

    assert slow.mode is mode
    assert kind.drives(slow, [0.3, 0.6]) == kind.drives(quick, [0.3, 0.6])


def test_pairs_removed_by_a_full_memory_are_counted(kind: Kind) -> None:
    """A decaying command has more extrema than the memory can hold."""
    subject = kind.compensator(Mode.FEEDFORWARD)

    kind.drives(subject, 0.5 + 0.4 * 0.95 ** np.arange(200) * (-1.0) ** np.arange(200))

    assert subject.merged_pairs > 0
