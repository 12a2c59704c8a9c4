"""Tests of the compensator: the drive in each mode, and the memory of the applied voltage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.hysteresis import ExactInverse
from tests.control.made_up import FORM, WEIGHTS, compensator, drives, inverse, sine

OTHER = 1.6 * WEIGHTS
NONE = np.zeros(8)

COMMANDS = st.lists(st.floats(0, 1), min_size=1, max_size=40)
WINDOWS = st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=40)


def displacement_of() -> ExactInverse:
    """Return the exact inverse of the inverse model: from drive to displacement."""
    return inverse().exact_inverse()


@given(commands=COMMANDS)
def test_uncompensated_drive_is_proportional_to_the_command(commands: list[float]) -> None:
    """For any model the normalised drive is the normalised command."""
    np.testing.assert_allclose(
        drives(compensator(Mode.UNCOMPENSATED), commands), commands, rtol=0, atol=1e-15
    )


@given(commands=COMMANDS)
def test_feedforward_drive_is_that_of_the_inverse_model(commands: list[float]) -> None:
    """The operators give the same drive as the closed form."""
    np.testing.assert_allclose(
        drives(compensator(Mode.FEEDFORWARD), commands),
        inverse().run(commands),
        rtol=0,
        atol=1e-12,
    )


@given(commands=COMMANDS)
def test_adaptive_drive_with_the_frozen_weights_is_feedforward(commands: list[float]) -> None:
    """Following an identifier that learns nothing changes nothing, to the bit."""
    assert drives(compensator(Mode.ADAPTIVE), commands) == drives(
        compensator(Mode.FEEDFORWARD), commands
    )


@pytest.mark.parametrize(
    ("follows", "base"), [(False, Mode.FEEDFORWARD), (True, Mode.ADAPTIVE)], ids=["fixed", "adapts"]
)
def test_trimmed_drive_is_that_of_its_base(follows: bool, base: Mode) -> None:
    """Without a trim both drives are the same to the bit."""
    trimmed = Compensator(FORM, WEIGHTS, mode=Mode.TRIMMED, fade_cycles=1, trimmed_follows=follows)

    assert drives(trimmed, sine(2), OTHER) == drives(compensator(base), sine(2), OTHER)


def test_trim_is_added_to_the_displacement_that_is_compensated() -> None:
    """The trim passes through the inverse model like the command."""
    subject, trims = compensator(Mode.TRIMMED), 0.05 * np.sin(np.arange(2000) / 300)

    trimmed = [subject.step(x, 0.0, 1.0, NONE, trim=t) for x, t in zip(sine(2), trims, strict=True)]

    np.testing.assert_allclose(trimmed, inverse().run(sine(2) + trims), rtol=0, atol=1e-12)


def test_offset_is_followed_in_adaptive_mode_only() -> None:
    """The offset is subtracted from the command; it stays when the mode is left."""
    subject = compensator(Mode.FEEDFORWARD)
    assert (
        subject.step(0.5, 0.0, 1.0, WEIGHTS, offset=0.1)
        == drives(compensator(Mode.FEEDFORWARD), [0.5]).pop()
    )

    subject.switch(Mode.ADAPTIVE)
    for _ in range(200):
        subject.step(0.5, 0.0, 1.0, WEIGHTS, offset=0.1)
    subject.switch(Mode.FEEDFORWARD)
    drifted = subject.step(0.7, 0.0, 1.0, WEIGHTS, offset=-0.1)

    assert drifted == pytest.approx(inverse().run([0.5, 0.4, 0.6])[-1], abs=1e-12)


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


def test_limited_direction_is_the_one_without_room() -> None:
    """It is set if the drive is limited, or else the displacement."""
    subject = compensator(Mode.FEEDFORWARD)
    seen = []
    for command, low, high, trim in [
        (0.5, 0.0, 1.0, 0.0),
        (0.9, 0.0, 0.6, 0.0),  # drive too low
        (0.1, 0.4, 1.0, 0.0),  # drive too high
        (0.0, 0.0, 1.0, -0.01),  # displacement at its lower end
        (1.0, 0.0, 1.0, 0.01),  # and at its upper one
        (0.5, 0.0, 1.0, 0.01),
    ]:
        subject.step(command, low, high, WEIGHTS, trim=trim)
        seen.append((subject.limited_direction, subject.limited))

    assert seen == [(0, False), (1, True), (-1, True), (-1, False), (1, False), (0, False)]


def test_adaptive_drive_follows_the_identifier() -> None:
    """The weights in use approach those of the identifier, and stay when the mode is left."""
    subject = compensator(Mode.ADAPTIVE)
    drives(subject, np.full(200, 0.5), OTHER)
    np.testing.assert_allclose(subject.weights, OTHER, atol=1e-12)

    subject.switch(Mode.FEEDFORWARD)
    drives(subject, np.full(200, 0.5), NONE)

    np.testing.assert_allclose(subject.weights, OTHER, atol=1e-12)


@pytest.mark.parametrize("mode", [Mode.UNCOMPENSATED, Mode.FEEDFORWARD])
def test_weights_are_fixed_in_the_other_modes(mode: Mode) -> None:
    """The weights of the identifier do not matter."""
    subject = compensator(mode)

    drives(subject, sine(2), OTHER)

    assert subject.weights.tolist() == WEIGHTS.tolist()


@given(windows=WINDOWS, commands=COMMANDS, mode=st.sampled_from(list(Mode)))
def test_drive_never_leaves_the_window(
    windows: list[tuple[float, float]], commands: list[float], mode: Mode
) -> None:
    """The limits hold in every mode."""
    subject = compensator(mode)
    for command, ends in zip(commands, windows, strict=False):
        low, high = sorted(ends)

        assert low <= subject.step(command, low, high, OTHER) <= high


@pytest.mark.parametrize("mode", list(Mode))
@given(windows=WINDOWS, commands=COMMANDS, after=COMMANDS)
def test_memory_advances_with_the_applied_voltage(
    mode: Mode, windows: list[tuple[float, float]], commands: list[float], after: list[float]
) -> None:
    """After limited drives the memory is that of the applied voltages."""
    subject, displacement, reference = compensator(mode), displacement_of(), inverse()
    for command, ends in zip(commands, windows, strict=False):
        low, high = sorted(ends)
        applied = subject.step(command, low, high, WEIGHTS)
        reference.step(displacement.step(applied))

    subject.switch(Mode.FEEDFORWARD)

    np.testing.assert_allclose(drives(subject, after), reference.run(after), rtol=0, atol=1e-9)


def test_drive_beyond_the_range_of_the_model_leaves_the_memory_at_its_end() -> None:
    """If the limits allow more than the model covers, the memory is at 0 or at 1."""
    subject = compensator(Mode.FEEDFORWARD)

    assert subject.step(0.5, 1.2, 1.3, WEIGHTS) == 1.2
    assert subject.step(0.5, -0.2, -0.1, WEIGHTS) == -0.1

    expected = inverse()
    expected.run([1.0, 0.0])
    after = [0.3, 0.2, 0.7]
    np.testing.assert_allclose(drives(subject, after), expected.run(after), rtol=0, atol=1e-12)


@pytest.mark.parametrize("mode", list(Mode))
def test_command_that_is_not_a_number_holds_the_drive(mode: Mode) -> None:
    """NaN moves nothing, and the next command is followed as if NaN had not come."""
    subject, spared = compensator(mode), compensator(mode)
    last = drives(subject, [0.2, 0.7, 0.4])[-1]
    drives(spared, [0.2, 0.7, 0.4])

    assert subject.step(float("nan"), 0.0, 1.0, WEIGHTS) == pytest.approx(last, abs=1e-12)
    np.testing.assert_allclose(drives(subject, [0.5, 0.3]), drives(spared, [0.5, 0.3]), atol=1e-12)


def test_command_outside_the_range_is_clamped() -> None:
    """A command outside the model's displacement is its nearest end."""
    assert drives(compensator(Mode.FEEDFORWARD), [0.5, 1.7, -3.0]) == drives(
        compensator(Mode.FEEDFORWARD), [0.5, 1.0, 0.0]
    )


@pytest.mark.parametrize("mode", list(Mode))
def test_compensator_starts_in_its_mode(mode: Mode) -> None:
    """There is no fade at the start."""
    slow, quick = compensator(mode, fade_cycles=1000), compensator(mode)

    assert slow.mode is mode
    assert drives(slow, [0.3, 0.6]) == drives(quick, [0.3, 0.6])


def test_pairs_removed_by_a_full_memory_are_counted() -> None:
    """A decaying command has more extrema than the memory can hold."""
    subject = compensator(Mode.FEEDFORWARD)

    drives(subject, 0.5 + 0.4 * 0.95 ** np.arange(200) * (-1.0) ** np.arange(200))

    assert subject.merged_pairs > 0
