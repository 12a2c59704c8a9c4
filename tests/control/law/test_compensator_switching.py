"""Tests of changes of mode and of weights: the drive never jumps."""

from itertools import permutations

import numpy as np
import pytest

from piezod.config.modes import Mode
from tests.control.made_up import STOPS, WEIGHTS, Array, Kind, compensator, drives, sine

NONE = np.zeros(8)
FADE = 100
SAME_DRIVES = ({Mode.FEEDFORWARD, Mode.TRIMMED}, {Mode.ADAPTIVE, Mode.CLOSED})
OTHER_DRIVES = [pair for pair in permutations(Mode, 2) if set(pair) not in SAME_DRIVES]
"""Pairs of modes whose drives differ."""


def path_with_switch(kind: Kind, start: Mode, end: Mode | None, at: int, commands: Array) -> Array:
    """Return the drives for a change of mode before a command, on a stage that slowly changes."""
    subject = kind.compensator(start, fade_cycles=FADE)
    out = []
    for k, command in enumerate(commands):
        if k == at and end is not None:
            subject.switch(end)
        learned = kind.other + 0.5 * np.sin(2e-3 * k) * (kind.other - kind.weights)
        out.append(subject.step(command, 0.0, 1.0, learned))
    return np.array(out)


@pytest.mark.fault("D9")
@pytest.mark.parametrize(("start", "end"), OTHER_DRIVES)
@pytest.mark.parametrize("at", [400, 1370, 2000])
def test_switch_is_bumpless(kind: Kind, start: Mode, end: Mode, at: int) -> None:
    """No step is larger than the command explains, plus some per cent of the difference."""
    commands = sine(4)[: at + 2 * FADE]
    switched = path_with_switch(kind, start, end, at, commands)
    unswitched = path_with_switch(kind, start, None, at, commands)
    during = slice(at - 1, at + FADE + 1)

    difference = np.max(np.abs(switched - unswitched)[during])
    explained = 1.05 * np.max(np.abs(np.diff(unswitched[during]))) + 3 * difference / FADE
    assert difference > 1e-4
    assert np.max(np.abs(np.diff(switched[during]))) < explained
    assert np.max(np.abs(np.diff(switched))) < 1.5 * np.max(np.abs(np.diff(unswitched))) + 1e-3


@pytest.mark.parametrize(("start", "end"), OTHER_DRIVES)
def test_switch_at_standstill_fades_to_the_new_drive(kind: Kind, start: Mode, end: Mode) -> None:
    """At a constant command the drive moves evenly and ends after the fade."""
    subject = kind.compensator(start, fade_cycles=FADE)
    held = kind.drives(subject, [*sine(1.3), *np.full(FADE, 0.6)], kind.other)[-1]

    subject.switch(end)
    after = np.array([held, *kind.drives(subject, np.full(3 * FADE, 0.6), kind.other)])

    steps = np.diff(after)
    # Mode and weights fade together, so that the drive may turn on its way.
    assert np.max(np.abs(steps)) <= 3 * np.sum(np.abs(steps)) / FADE
    np.testing.assert_allclose(after[FADE + 1 :], after[-1], rtol=0, atol=1e-9)


def test_switch_during_a_fade_is_bumpless(kind: Kind) -> None:
    """Frequent changes of mode make no jump either."""
    commands = sine(4)
    subject = kind.compensator(Mode.UNCOMPENSATED, fade_cycles=FADE)
    steady = np.max(np.abs(np.diff(kind.drives(kind.compensator(Mode.FEEDFORWARD), commands))))
    out = []
    for k, command in enumerate(commands):
        if k % 30 == 0:
            subject.switch(list(Mode)[k // 30 % 4])
        out.append(subject.step(command, 0.0, 1.0, kind.other))

    assert np.max(np.abs(np.diff(out))) < 1.5 * steady + 1e-3


def test_first_weights_that_converge_are_adopted_once() -> None:
    """A stage without a model gets the first weights; later ones do not replace them."""
    subject = compensator(Mode.FEEDFORWARD, weights=NONE)
    assert drives(subject, [0.3, 0.6]) == [0.3, 0.6]

    subject.adopt_first(WEIGHTS)
    drives(subject, [0.5])
    subject.adopt_first(STOPS.other)
    drives(subject, [0.4])

    assert subject.weights.tolist() == WEIGHTS.tolist()


def test_given_weights_are_not_replaced_by_converged_ones(kind: Kind) -> None:
    """A stage with a model keeps it."""
    subject = kind.compensator(Mode.FEEDFORWARD)

    subject.adopt_first(kind.other)
    kind.drives(subject, [0.5])

    assert subject.weights.tolist() == kind.weights.tolist()


def test_weights_are_adopted_without_a_jump(kind: Kind) -> None:
    """At standstill the drive fades from one model to the other."""
    subject = kind.compensator(Mode.FEEDFORWARD, fade_cycles=FADE)
    held = kind.drives(subject, [*sine(1.3), 0.6])[-1]

    subject.adopt(kind.other)
    after = np.array([held, *kind.drives(subject, np.full(2 * FADE, 0.6))])

    assert abs(after[-1] - held) > 1e-3
    assert np.max(np.abs(np.diff(after))) < 2 * abs(after[-1] - held) / FADE
    np.testing.assert_allclose(subject.weights, kind.other, rtol=1e-12)


def test_switch_during_an_adoption_does_not_stop_it() -> None:
    """The new weights arrive although the mode changes meanwhile."""
    subject = compensator(Mode.UNCOMPENSATED, weights=NONE, fade_cycles=FADE)
    subject.adopt_first(WEIGHTS)
    drives(subject, np.full(FADE // 2, 0.3))

    subject.switch(Mode.FEEDFORWARD)
    drives(subject, np.full(FADE, 0.3))

    np.testing.assert_allclose(subject.weights, WEIGHTS, rtol=1e-12)
