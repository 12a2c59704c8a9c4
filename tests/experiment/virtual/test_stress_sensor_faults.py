"""Tests that a temporary sensor fault leaves no trace in the learned model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from piezod.devices.interface import Sample
from piezod.hysteresis.memory import FloatArray
from tests.conftest import Figure
from tests.experiment.stress_rig import (
    SWING_UM,
    Identified,
    StressRig,
    listed,
    swing_um,
    worst_pct,
)

NOISE_UM = 0.018
"""Noise of the sensor, rms."""

Fault = Callable[[Sample], Sample]


def stuck() -> Fault:
    """Return a sensor that shows the same value for ever."""
    shown: list[float] = []

    def tamper(sample: Sample) -> Sample:
        shown.append(sample.position_um)
        return sample._replace(position_um=shown[0])

    return tamper


def noisy() -> Fault:
    """Return a sensor with ten times its noise."""
    draws = np.random.default_rng(5)
    more_um = np.sqrt(10.0**2 - 1.0) * NOISE_UM

    def tamper(sample: Sample) -> Sample:
        return sample._replace(position_um=sample.position_um + more_um * draws.standard_normal())

    return tamper


def spiking() -> Fault:
    """Return a sensor that is off by 10 % of the range."""
    return lambda sample: sample._replace(position_um=sample.position_um + 0.1 * SWING_UM)


def late() -> Fault:
    """Return a sensor with twice its delay, without a notice."""
    share, before_um = 0.63, float("nan")

    def tamper(sample: Sample) -> Sample:
        nonlocal before_um
        last_um, before_um = before_um, sample.position_um
        if np.isnan(last_um):
            return sample
        return sample._replace(position_um=share * last_um + (1.0 - share) * before_um)

    return tamper


def gone() -> Fault:
    """Return a sensor without valid samples."""
    return lambda sample: sample._replace(position_um=float("nan"), valid=False)


@dataclass
class Course:
    """What happened in a run through a fault."""

    rig: StressRig  #: What ran.
    learning_cycles: int = 0  #: Cycles of the fault in which something was learned.
    #: What was known at the beginning of the fault, at its end, and some time after.
    learned: list[FloatArray] = field(default_factory=list)
    #: Worst true error during the fault, and up to each of these times, in %.
    worst: list[float] = field(default_factory=list)

    def watch(self, _cycle: int) -> None:
        """Note whether anything was learned in the last cycle."""
        now = self.rig.learned
        self.learning_cycles += not np.array_equal(now, self.learned[-1])
        self.learned[-1] = now

    def moved_pct(self, other: "Course") -> FloatArray:
        """Return the difference to the learned model of another run, in % of the range."""
        pairs = zip(self.learned, other.learned, strict=True)
        return np.array([self.rig.moved_pct(one, another) for one, another in pairs])


def through(
    stage: Identified,
    fault: Fault | None,
    begin_s: float,
    duration_s: float,
    after_s: Sequence[float],
) -> Course:
    """Swing fully, with a sensor fault from a time on and for a duration, and go on after it."""
    course = Course(StressRig(stage, swing_um))
    course.rig.run(begin_s)
    course.learned += [course.rig.learned] * 2
    course.rig.channels.tamper = fault
    duration_s = max(duration_s, 1.0 / stage.config.rate_hz)  # one cycle at least
    course.worst.append(worst_pct(course.rig.run(duration_s, course.watch)))
    course.watch(0)
    course.rig.channels.tamper = None
    for last_s, until_s in zip((0.0, *after_s[:-1]), after_s, strict=True):
        course.worst.append(worst_pct(course.rig.run(until_s - last_s)))
        course.learned.append(course.rig.learned)
    return course


UNDISTURBED: dict[tuple[float, float, float, tuple[float, ...]], Course] = {}


def without_fault(
    stage: Identified, begin_s: float, duration_s: float, after_s: tuple[float, ...]
) -> Course:
    """Return the result of `through` without a fault, once for each rate and times."""
    key = stage.config.rate_hz, begin_s, duration_s, after_s
    if key not in UNDISTURBED:
        UNDISTURBED[key] = through(stage, None, begin_s, duration_s, after_s)
    return UNDISTURBED[key]


FAULTS = {
    "stuck for 1 s": (stuck, 1.0, 1, 0.05),
    "no samples for 1 s": (gone, 1.0, 0, 0.0),
    "noise x10 for 4 s": (noisy, 4.0, 20, 1.0),
    "delay doubled for 4 s": (late, 4.0, 4000, 0.5),
    "spike of 10 %": (spiking, 0.001, 0, 0.0),
}
"""Fault, duration, largest number of its cycles with learning, and its effect, in %."""

LATER_S = (7.1, 7.5, 7.9)
BEGINS_S = [3.1, *(pytest.param(begin_s, marks=pytest.mark.stress) for begin_s in LATER_S)]
"""Begin of the fault: on the way down, at the turn, on the way up, and before the turn."""


FAST = {"spike of 10 %"}


@pytest.mark.parametrize(
    "after_s", [(1.0, 3.0), pytest.param((1.0, 3.0, 10.0), marks=pytest.mark.stress)]
)
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in FAST else pytest.mark.stress) for n in FAULTS]
)
@pytest.mark.parametrize("begin_s", BEGINS_S)
def test_fault_of_the_sensor_leaves_nothing_behind(
    beyond_stage: Identified,
    figure: Figure,
    name: str,
    begin_s: float,
    after_s: tuple[float, ...],
) -> None:
    """Little is learned during the fault and nothing stays; the true error is below 1 %."""
    fault, duration_s, most_learning_cycles, most_moved_pct = FAULTS[name]
    course = through(beyond_stage, fault(), begin_s, duration_s, after_s)
    undisturbed = without_fault(beyond_stage, begin_s, duration_s, after_s)
    moved_pct = course.moved_pct(undisturbed)[2:]
    begin, end = course.learned[:2]
    moved_meanwhile_pct = course.rig.moved_pct(begin, end)
    figure(
        f"sensor {name}, from {begin_s:g} s on: learned in {course.learning_cycles} cycles, moved "
        f"{moved_meanwhile_pct:.3f} %; off an undisturbed run {listed(np.array(after_s))} s later "
        f"{listed(moved_pct)} %; worst true error {listed(np.array(course.worst))} % "
        f"(undisturbed {listed(np.array(undisturbed.worst))} %)"
    )

    assert course.learning_cycles <= most_learning_cycles
    assert moved_meanwhile_pct <= most_moved_pct
    assert moved_pct[-1] < 0.2
    assert max(course.worst) < 1.0
