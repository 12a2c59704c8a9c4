"""The compensator: modes, bumpless switches, and a memory that knows what was applied."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.modes import Mode
from piezod.control.compensator import Compensator
from piezod.hysteresis import ExactInverse
from tests.control.made_up import BANK, WEIGHTS, Array, inverse

OTHER = 1.6 * WEIGHTS
NONE = np.zeros(8)
FADE = 100
OTHER_DRIVES = [p for p in permutations(Mode, 2) if set(p) != {Mode.FEEDFORWARD, Mode.TRIMMED}]
"""Pairs of modes whose drives differ."""

COMMANDS = st.lists(st.floats(0, 1), min_size=1, max_size=40)
WINDOWS = st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=40)


def displacement_of() -> ExactInverse:
    """Return what finds the displacement at which that inverse model gives a drive."""
    return inverse().exact_inverse()


def compensator(mode: Mode, weights: Array = WEIGHTS, fade_cycles: int = 1) -> Compensator:
    """Return a compensator at rest."""
    return Compensator(BANK, weights, mode=mode, fade_cycles=fade_cycles)


def drives(
    one: Compensator, commands: list[float] | Array, identified: Array = WEIGHTS
) -> list[float]:
    """Return the drives for commands when the limits leave everything open."""
    return [one.step(command, 0.0, 1.0, identified) for command in commands]


def sine(seconds: float) -> Array:
    """Return a command of 0.5 Hz at 1 kHz that grows and shrinks."""
    t = np.arange(0, seconds, 1e-3)
    return 0.5 - (0.5 - 0.2 * np.cos(0.3 * t)) * np.cos(np.pi * t) * 0.9


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


def test_stop_says_which_way_nothing_more_is_to_be_had() -> None:
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
        seen.append((one.stop, one.limited))

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


def path_with_switch(start: Mode, end: Mode | None, at: int, commands: Array) -> Array:
    """Return the drives when the mode is switched before a command, the stage changing slowly."""
    one = compensator(start, fade_cycles=FADE)
    out = []
    for k, command in enumerate(commands):
        if k == at and end is not None:
            one.switch(end)
        out.append(one.step(command, 0.0, 1.0, (1 + 0.5 * np.sin(2e-3 * k)) * OTHER))
    return np.array(out)


@pytest.mark.parametrize(("start", "end"), OTHER_DRIVES)
@pytest.mark.parametrize("at", [400, 1000, 1370, 2000, 2805])
def test_switch_is_bumpless(start: Mode, end: Mode, at: int) -> None:
    """No step is larger than what the command asks for plus some per cent of the difference."""
    commands = sine(4)
    switched = path_with_switch(start, end, at, commands)
    unswitched = path_with_switch(start, None, at, commands)
    during = slice(at - 1, at + FADE + 1)

    difference = np.max(np.abs(switched - unswitched)[during])
    explained = 1.05 * np.max(np.abs(np.diff(unswitched[during]))) + 3 * difference / FADE
    assert difference > 1e-4
    assert np.max(np.abs(np.diff(switched[during]))) < explained
    assert np.max(np.abs(np.diff(switched))) < 1.5 * np.max(np.abs(np.diff(unswitched))) + 1e-3


@pytest.mark.parametrize(("start", "end"), OTHER_DRIVES)
def test_switch_at_a_standstill_glides_to_the_new_drive(start: Mode, end: Mode) -> None:
    """At a constant command the drive goes one way, evenly, and arrives after the fade."""
    one = compensator(start, fade_cycles=FADE)
    held = drives(one, [*sine(1.3), *np.full(FADE, 0.6)], OTHER)[-1]

    one.switch(end)
    after = np.array([held, *drives(one, np.full(3 * FADE, 0.6), OTHER)])

    steps = np.diff(after)
    assert np.max(np.abs(steps)) <= 3 * abs(after[-1] - held) / FADE
    np.testing.assert_allclose(after[FADE + 1 :], after[-1], rtol=0, atol=1e-9)


def test_switch_in_the_middle_of_a_fade_is_bumpless_too() -> None:
    """An impatient hand on the switch makes no jump either."""
    commands = sine(4)
    one = compensator(Mode.UNCOMPENSATED, fade_cycles=FADE)
    steady = np.max(np.abs(np.diff(drives(compensator(Mode.FEEDFORWARD), commands))))
    out = []
    for k, command in enumerate(commands):
        if k % 30 == 0:
            one.switch(list(Mode)[k // 30 % 4])
        out.append(one.step(command, 0.0, 1.0, OTHER))

    assert np.max(np.abs(np.diff(out))) < 1.5 * steady + 1e-3


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


def test_first_weights_that_converge_are_adopted_once() -> None:
    """A stage without a model gets one; what is identified later does not replace it."""
    one = compensator(Mode.FEEDFORWARD, weights=NONE)
    assert drives(one, [0.3, 0.6]) == [0.3, 0.6]

    one.adopt_first(WEIGHTS)
    drives(one, [0.5])
    one.adopt_first(OTHER)
    drives(one, [0.4])

    assert one.weights.tolist() == WEIGHTS.tolist()


def test_weights_that_were_given_are_not_replaced_by_the_first_that_converge() -> None:
    """A stage with a model keeps it."""
    one = compensator(Mode.FEEDFORWARD)

    one.adopt_first(OTHER)
    drives(one, [0.5])

    assert one.weights.tolist() == WEIGHTS.tolist()


def test_weights_are_adopted_without_a_jump() -> None:
    """At a standstill the drive glides from one model to the other."""
    one = compensator(Mode.FEEDFORWARD, fade_cycles=FADE)
    held = drives(one, [*sine(1.3), 0.6])[-1]

    one.adopt(OTHER)
    after = np.array([held, *drives(one, np.full(2 * FADE, 0.6))])

    assert abs(after[-1] - held) > 1e-3
    assert np.max(np.abs(np.diff(after))) < 2 * abs(after[-1] - held) / FADE
    np.testing.assert_allclose(one.weights, OTHER, rtol=1e-12)


def test_switch_during_an_adoption_loses_nothing() -> None:
    """Weights on their way in arrive, whatever the switch does meanwhile."""
    one = compensator(Mode.UNCOMPENSATED, weights=NONE, fade_cycles=FADE)
    one.adopt_first(WEIGHTS)
    drives(one, np.full(FADE // 2, 0.3))

    one.switch(Mode.FEEDFORWARD)
    drives(one, np.full(FADE, 0.3))

    np.testing.assert_allclose(one.weights, WEIGHTS, rtol=1e-12)


def test_pairs_given_up_by_a_full_memory_are_counted() -> None:
    """A decaying command has more extrema than there is place for."""
    one = compensator(Mode.FEEDFORWARD)

    drives(one, 0.5 + 0.4 * 0.95 ** np.arange(200) * (-1.0) ** np.arange(200))

    assert one.merged_pairs > 0
