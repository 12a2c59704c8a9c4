"""The compensator: what it makes of a command in each mode, with a memory of what was applied."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.hysteresis import ExactInverse
from tests.control.made_up import BANK, WEIGHTS, compensator, drives, inverse, sine

OTHER = 1.6 * WEIGHTS
NONE = np.zeros(8)

COMMANDS = st.lists(st.floats(0, 1), min_size=1, max_size=40)
WINDOWS = st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=40)


def displacement_of() -> ExactInverse:
    """Return what finds the displacement at which that inverse model gives a drive."""
    return inverse().exact_inverse()


@given(commands=COMMANDS)
def test_uncompensated_drive_is_proportional_to_the_command(commands: list[float]) -> None:
    """Whatever the model says, the normalised drive is the normalised command."""
    np.testing.assert_allclose(
        drives(compensator(Mode.UNCOMPENSATED), commands), commands, rtol=0, atol=1e-15
    )


@given(commands=COMMANDS)
def test_feedforward_drive_is_that_of_the_inverse_model(commands: list[float]) -> None:
    """The operators give what the closed form gives."""
    np.testing.assert_allclose(
        drives(compensator(Mode.FEEDFORWARD), commands),
        inverse().run(commands),
        rtol=0,
        atol=1e-12,
    )


@given(commands=COMMANDS)
def test_adaptive_drive_with_the_frozen_weights_is_feedforward(commands: list[float]) -> None:
    """Following an identifier that says nothing new changes nothing, to the bit."""
    assert drives(compensator(Mode.ADAPTIVE), commands) == drives(
        compensator(Mode.FEEDFORWARD), commands
    )


@pytest.mark.parametrize(
    ("follows", "base"), [(False, Mode.FEEDFORWARD), (True, Mode.ADAPTIVE)], ids=["fixed", "adapts"]
)
def test_trimmed_drive_is_that_of_its_base(follows: bool, base: Mode) -> None:
    """Without a trim they are the same, to the bit."""
    trimmed = Compensator(BANK, WEIGHTS, mode=Mode.TRIMMED, fade_cycles=1, trimmed_follows=follows)

    assert drives(trimmed, sine(2), OTHER) == drives(compensator(base), sine(2), OTHER)


def test_trim_is_added_to_the_displacement_that_is_compensated() -> None:
    """It goes through the inverse, as the command does."""
    one, trims = compensator(Mode.TRIMMED), 0.05 * np.sin(np.arange(2000) / 300)

    trimmed = [one.step(x, 0.0, 1.0, NONE, trim=t) for x, t in zip(sine(2), trims, strict=True)]

    np.testing.assert_allclose(trimmed, inverse().run(sine(2) + trims), rtol=0, atol=1e-12)


def test_offset_is_followed_in_adaptive_mode_only() -> None:
    """What the stage has drifted by is not asked of the hysteresis; it stays when left."""
    one = compensator(Mode.FEEDFORWARD)
    assert (
        one.step(0.5, 0.0, 1.0, WEIGHTS, offset=0.1)
        == drives(compensator(Mode.FEEDFORWARD), [0.5]).pop()
    )

    one.switch(Mode.ADAPTIVE)
    for _ in range(200):
        one.step(0.5, 0.0, 1.0, WEIGHTS, offset=0.1)
    one.switch(Mode.FEEDFORWARD)
    drifted = one.step(0.7, 0.0, 1.0, WEIGHTS, offset=-0.1)

    assert drifted == pytest.approx(inverse().run([0.5, 0.4, 0.6])[-1], abs=1e-12)


def test_scale_is_followed_in_adaptive_mode_only() -> None:
    """A stage that moves further is asked for less; an offset counts besides."""
    one = compensator(Mode.FEEDFORWARD)
    fixed = one.step(0.5, 0.0, 1.0, WEIGHTS, scale=-0.1)
    assert fixed == drives(compensator(Mode.FEEDFORWARD), [0.5]).pop()

    one.switch(Mode.ADAPTIVE)
    for _ in range(200):
        one.step(0.5, 0.0, 1.0, WEIGHTS, offset=0.05, scale=-0.1)
    one.switch(Mode.FEEDFORWARD)
    scaled = one.step(0.8, 0.0, 1.0, WEIGHTS, scale=0.2)

    assert scaled == pytest.approx(inverse().run([0.5, 0.4, 0.67])[-1], abs=1e-12)


def test_scale_beyond_the_range_stops_at_its_end() -> None:
    """A stage that moves less cannot reach the top: the drive stays within the model's range."""
    one = compensator(Mode.ADAPTIVE)

    top = [one.step(0.95, 0.0, 2.0, WEIGHTS, scale=0.1) for _ in range(200)][-1]

    assert top == pytest.approx(1.0, abs=1e-12)
    assert (one.limited_direction, one.limited) == (1, False)


def test_limited_direction_is_the_one_without_room() -> None:
    """Neither from the drive nor from the displacement."""
    one = compensator(Mode.FEEDFORWARD)
    seen = []
    for command, low, high, trim in [
        (0.5, 0.0, 1.0, 0.0),
        (0.9, 0.0, 0.6, 0.0),  # drive too low
        (0.1, 0.4, 1.0, 0.0),  # drive too high
        (0.0, 0.0, 1.0, -0.01),  # displacement at its lower end
        (1.0, 0.0, 1.0, 0.01),  # and at its upper one
        (0.5, 0.0, 1.0, 0.01),
    ]:
        one.step(command, low, high, WEIGHTS, trim=trim)
        seen.append((one.limited_direction, one.limited))

    assert seen == [(0, False), (1, True), (-1, True), (-1, False), (1, False), (0, False)]


def test_adaptive_drive_follows_the_identifier() -> None:
    """The weights in use come to those of the identifier, and stay when it is left."""
    one = compensator(Mode.ADAPTIVE)
    drives(one, np.full(200, 0.5), OTHER)
    np.testing.assert_allclose(one.weights, OTHER, atol=1e-12)

    one.switch(Mode.FEEDFORWARD)
    drives(one, np.full(200, 0.5), NONE)

    np.testing.assert_allclose(one.weights, OTHER, atol=1e-12)


@pytest.mark.parametrize("mode", [Mode.UNCOMPENSATED, Mode.FEEDFORWARD])
def test_weights_are_fixed_in_the_other_modes(mode: Mode) -> None:
    """What the identifier says meanwhile does not matter."""
    one = compensator(mode)

    drives(one, sine(2), OTHER)

    assert one.weights.tolist() == WEIGHTS.tolist()


@given(windows=WINDOWS, commands=COMMANDS, mode=st.sampled_from(list(Mode)))
def test_drive_never_leaves_the_window(
    windows: list[tuple[float, float]], commands: list[float], mode: Mode
) -> None:
    """The limits have the last word in every mode."""
    one = compensator(mode)
    for command, ends in zip(commands, windows, strict=False):
        low, high = sorted(ends)

        assert low <= one.step(command, low, high, OTHER) <= high


@pytest.mark.parametrize("mode", list(Mode))
@given(windows=WINDOWS, commands=COMMANDS, after=COMMANDS)
def test_memory_advances_with_the_applied_voltage(
    mode: Mode, windows: list[tuple[float, float]], commands: list[float], after: list[float]
) -> None:
    """After clipping the inverse stands where the voltages that were applied have brought it."""
    one, displacement, reference = compensator(mode), displacement_of(), inverse()
    for command, ends in zip(commands, windows, strict=False):
        low, high = sorted(ends)
        applied = one.step(command, low, high, WEIGHTS)
        reference.step(displacement.step(applied))

    one.switch(Mode.FEEDFORWARD)

    np.testing.assert_allclose(drives(one, after), reference.run(after), rtol=0, atol=1e-9)


def test_drive_beyond_the_range_of_the_model_is_its_end() -> None:
    """Limits may leave more open than the model knows: the memory then stands at 0 or at 1."""
    one = compensator(Mode.FEEDFORWARD)

    assert one.step(0.5, 1.2, 1.3, WEIGHTS) == 1.2
    assert one.step(0.5, -0.2, -0.1, WEIGHTS) == -0.1

    expected = inverse()
    expected.run([1.0, 0.0])
    after = [0.3, 0.2, 0.7]
    np.testing.assert_allclose(drives(one, after), expected.run(after), rtol=0, atol=1e-12)


@pytest.mark.parametrize("mode", list(Mode))
def test_command_that_is_not_a_number_holds_the_drive(mode: Mode) -> None:
    """No move is the only safe answer, and the next command is followed as if nothing had been."""
    one, spared = compensator(mode), compensator(mode)
    last = drives(one, [0.2, 0.7, 0.4])[-1]
    drives(spared, [0.2, 0.7, 0.4])

    assert one.step(float("nan"), 0.0, 1.0, WEIGHTS) == pytest.approx(last, abs=1e-12)
    np.testing.assert_allclose(drives(one, [0.5, 0.3]), drives(spared, [0.5, 0.3]), atol=1e-12)


def test_command_outside_the_range_is_clamped() -> None:
    """A command beyond the model's displacement asks for its end."""
    assert drives(compensator(Mode.FEEDFORWARD), [0.5, 1.7, -3.0]) == drives(
        compensator(Mode.FEEDFORWARD), [0.5, 1.0, 0.0]
    )


@pytest.mark.parametrize("mode", list(Mode))
def test_compensator_starts_in_its_mode(mode: Mode) -> None:
    """At the start there is nothing to fade from."""
    slow, quick = compensator(mode, fade_cycles=1000), compensator(mode)

    assert slow.mode is mode
    assert drives(slow, [0.3, 0.6]) == drives(quick, [0.3, 0.6])


def test_pairs_given_up_by_a_full_memory_are_counted() -> None:
    """A decaying command has more extrema than there is place for."""
    one = compensator(Mode.FEEDFORWARD)

    drives(one, 0.5 + 0.4 * 0.95 ** np.arange(200) * (-1.0) ** np.arange(200))

    assert one.merged_pairs > 0
