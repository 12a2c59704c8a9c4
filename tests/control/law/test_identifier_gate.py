"""Tests of the learning gate, by scenario."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.gate_reasons import GateReason
from piezod.control.law.identifier import LIMITED_CYCLES, SPIKE_CYCLES, LearningGate
from piezod.control.signals import STUCK_SAMPLES
from tests.control.fakes import MS

SIGMA = 6e-4  # of the range: 18 nm on 30 µm


class Cycle(NamedTuple):
    """Arguments of the gate in a cycle."""

    drive: float
    position: float
    valid: bool = True
    age_ns: int = 0
    limited: bool = False


Disturb = Callable[[int, Cycle], Cycle]


def sine(k: int) -> float:
    """Return a full swing at 1 Hz, in cycles of 1 ms."""
    return 0.5 - 0.5 * math.cos(2e-3 * math.pi * k)


def measured(seed: int, cycles: int, swing: float = 1.0) -> Iterator[Cycle]:
    """Yield the cycles of a stage that follows its drive, with noise."""
    noise = np.random.default_rng(seed).normal(0.0, SIGMA, cycles).tolist()
    for k in range(cycles):
        drive = swing * sine(k)
        yield Cycle(drive, drive + noise[k])


def reasons(gate: LearningGate, cycles: Iterator[Cycle], disturb: Disturb) -> list[GateReason]:
    """Return the decision in each cycle."""
    decisions = []
    for k, cycle in enumerate(cycles):
        arguments = disturb(k, cycle)
        admitted = gate.admits(**arguments._asdict())
        assert admitted == (gate.reason is GateReason.OPEN)
        decisions.append(gate.reason)
    return decisions


def untouched(_: int, cycle: Cycle) -> Cycle:
    """Return the cycle unchanged."""
    return cycle


def closed_for(decisions: list[GateReason]) -> set[GateReason]:
    """Return the reasons for which the gate was closed."""
    return set(decisions) - {GateReason.OPEN}


def test_gate_stays_open_on_a_healthy_stage() -> None:
    """After a swing of 2 % of the range it admits every sample of ten seconds."""
    decisions = reasons(LearningGate(MS), measured(1, 10_000), untouched)

    assert decisions.index(GateReason.OPEN) == 46
    assert set(decisions[46:]) == {GateReason.OPEN}


def test_stuck_sensor_closes_the_gate() -> None:
    """It closes at the 20th equal sample; the jump back is a spike."""
    held = 0.0

    def stick(k: int, cycle: Cycle) -> Cycle:
        nonlocal held
        if 4250 <= k < 5200:
            return cycle._replace(position=held)
        held = cycle.position
        return cycle

    decisions = reasons(LearningGate(MS), measured(2, 8000), stick)

    stuck = [k for k, reason in enumerate(decisions) if reason is GateReason.STUCK]
    assert stuck == list(range(4249 + STUCK_SAMPLES - 1, 5200))
    assert set(decisions[4250 : 4249 + STUCK_SAMPLES - 1]) == {GateReason.REPEATED}
    assert set(decisions[5200 : 5201 + SPIKE_CYCLES]) == {GateReason.SPIKE}
    assert set(decisions[5201 + SPIKE_CYCLES :]) == {GateReason.OPEN}


def test_equal_samples_at_rest_do_not_mean_stuck() -> None:
    """Equal samples mean nothing while the drive hardly moves."""
    gate = LearningGate(MS)

    decisions = reasons(gate, (Cycle(0.4 + 0.00999 * (k % 2), 0.5) for k in range(5000)), untouched)

    assert set(decisions) == {GateReason.QUIET}


@pytest.mark.fault("S4")
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_spike_closes_the_gate_for_a_while(sign: float) -> None:
    """After a spike of 10 % the gate is closed for it, for the next two samples and for a while."""

    def spike(k: int, cycle: Cycle) -> Cycle:
        return cycle._replace(position=cycle.position + (0.1 * sign if k == 5000 else 0.0))

    decisions = reasons(LearningGate(MS), measured(3, 6000), spike)[1000:]

    closed = [k for k, reason in enumerate(decisions) if reason is GateReason.SPIKE]
    assert closed == list(range(4000, 4002 + SPIKE_CYCLES))
    assert closed_for(decisions) == {GateReason.SPIKE}


def test_noise_ten_times_larger_closes_the_gate() -> None:
    """It closes at the first spike, for some 30 s; then the noise counts as usual."""
    loud = np.random.default_rng(5)

    def shake(k: int, cycle: Cycle) -> Cycle:
        more = loud.normal(0.0, 10 * SIGMA) if k >= 5000 else 0.0
        return cycle._replace(position=cycle.position + more)

    decisions = reasons(LearningGate(MS), measured(4, 65_000), shake)[5000:]

    learned = [k for k, reason in enumerate(decisions) if reason is GateReason.OPEN]
    first = next(k for k, reason in enumerate(decisions) if reason is GateReason.SPIKE)
    assert first < 10
    assert 20_000 < next(k for k in learned if k > first) < 45_000
    assert set(decisions[-1000:]) == {GateReason.OPEN}


def test_gate_opens_again_when_the_noise_ends() -> None:
    """It opens within two seconds, and louder noise closes it again later."""
    gate, loud = LearningGate(MS), np.random.default_rng(8)

    def shake(_: int, cycle: Cycle) -> Cycle:
        return cycle._replace(position=cycle.position + loud.normal(0.0, 10 * SIGMA))

    reasons(gate, measured(4, 4000), untouched)
    reasons(gate, measured(6, 4000), shake)
    after = reasons(gate, measured(7, 4000), untouched)
    again = reasons(gate, measured(9, 4000), shake)

    assert set(after[1500:]) == {GateReason.OPEN}
    assert again[-1] is GateReason.NOISY


def test_repeated_sample_closes_the_gate() -> None:
    """The first of many samples of a stuck sensor looks like an equal sample by chance."""
    gate, held = LearningGate(MS), 0.0

    def repeat(k: int, cycle: Cycle) -> Cycle:
        nonlocal held
        held = held if k in {5000, 5001, 5500} else cycle.position
        return cycle._replace(position=held)

    decisions = reasons(gate, measured(3, 6000), repeat)[1000:]

    assert [k for k, reason in enumerate(decisions) if reason is GateReason.REPEATED] == [
        4000,
        4001,
        4500,
    ]
    assert closed_for(decisions) == {GateReason.REPEATED}
    assert gate.accurate


@pytest.mark.fault("D4")
@pytest.mark.parametrize("cycles", [20_000, pytest.param(50_000, marks=pytest.mark.stress)])
@pytest.mark.parametrize("noise", [0.0, SIGMA, 10 * SIGMA])
def test_gate_stays_closed_at_a_constant_command(noise: float, cycles: int) -> None:
    """Neither the duration nor the noise of the sensor matters."""
    gate, draws = LearningGate(MS), np.random.default_rng(6)
    drives = draws.normal(0.4, 1e-3, cycles).tolist()
    positions = draws.normal(0.5, noise, cycles).tolist()

    decisions = reasons(gate, map(Cycle, drives, positions), untouched)

    assert GateReason.OPEN not in decisions
    assert gate.counts[GateReason.OPEN] == 0


def test_swing_of_two_percent_is_enough() -> None:
    """A sine of 2 % peak to peak opens the gate when its swing is in the window."""
    decisions = reasons(LearningGate(MS), measured(7, 8000, 0.02), untouched)

    assert decisions.index(GateReason.OPEN) == 500
    assert GateReason.OPEN in decisions[-2000:]


def test_swing_below_two_percent_is_not_enough() -> None:
    """The duration of the swing does not matter."""
    decisions = reasons(LearningGate(MS), measured(7, 8000, 0.0199), untouched)

    assert set(decisions) == {GateReason.QUIET}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"valid": False}, GateReason.INVALID),
        ({"valid": False, "position": math.nan}, GateReason.INVALID),
        ({"position": math.nan}, GateReason.INVALID),
        ({"position": math.inf}, GateReason.INVALID),
        ({"age_ns": MS + 1}, GateReason.LATE),
        ({"age_ns": MS}, GateReason.OPEN),
        ({"valid": False, "age_ns": 9 * MS, "limited": True}, GateReason.INVALID),
        ({"age_ns": 9 * MS, "limited": True}, GateReason.LATE),
        ({"limited": True}, GateReason.LIMITED),
    ],
)
def test_unusable_sample_closes_the_gate(change: dict[str, Any], reason: GateReason) -> None:
    """The gate gives the first reason that applies; the values are at each edge."""

    def spoil(k: int, cycle: Cycle) -> Cycle:
        return cycle._replace(**change) if k == 1500 else cycle

    decisions = reasons(LearningGate(MS), measured(8, 1501), spoil)

    assert decisions[-2:] == [GateReason.OPEN, reason]


@pytest.mark.parametrize(
    ("change", "credible"),
    [
        ({}, True),
        ({"limited": True}, True),
        ({"valid": False}, False),
        ({"position": math.nan}, False),
        ({"age_ns": MS + 1}, False),
        ({"position": 0.3}, False),
        ({"position": 0.3, "limited": True}, False),
    ],
)
@pytest.mark.parametrize("swing", [1.0, 0.01])
def test_credible_does_not_depend_on_learning(
    change: dict[str, Any], credible: bool, swing: float
) -> None:
    """Invalid samples, late samples and spikes are not credible, also with a closed gate."""
    gate = LearningGate(MS)

    def spoil(k: int, cycle: Cycle) -> Cycle:
        return cycle._replace(**change) if k == 1500 else cycle

    reasons(gate, measured(8, 1501, swing), spoil)

    assert gate.credible is credible


def test_stuck_sensor_is_not_credible() -> None:
    """It is not credible from detection on, until it moves again."""
    gate, credible = LearningGate(MS), []
    for k, cycle in enumerate(measured(2, 1400)):
        stuck = 1200 <= k < 1300
        gate.admits(**cycle._replace(position=0.3 if stuck else cycle.position)._asdict())
        credible.append(gate.credible)

    assert not any(credible[1200 + STUCK_SAMPLES : 1300])
    assert all(credible[1310:])


@pytest.mark.parametrize("age_ns", [2 * MS, 3 * MS, 3 * MS + 1])
def test_latency_of_the_sensor_is_not_lateness(age_ns: int) -> None:
    """A sample is late one period after the latency of its sensor."""
    gate = LearningGate(MS, latency_ns=2 * MS)

    decisions = reasons(gate, measured(8, 1501), lambda _, cycle: cycle._replace(age_ns=age_ns))

    assert decisions[-1] is (GateReason.LATE if age_ns > 3 * MS else GateReason.OPEN)


def test_gate_stays_closed_after_the_drive_was_limited() -> None:
    """It stays closed for a few cycles after the limit."""

    def limit(k: int, cycle: Cycle) -> Cycle:
        return cycle._replace(limited=1500 <= k < 1503)

    decisions = reasons(LearningGate(MS), measured(9, 2000), limit)

    closed = [k for k, reason in enumerate(decisions) if reason is GateReason.LIMITED]
    assert closed == list(range(1500, 1503 + LIMITED_CYCLES))


@given(
    cycles=st.lists(
        st.builds(
            Cycle,
            st.floats(0.0, 1.0),
            st.floats(),
            st.booleans(),
            st.integers(0, 3 * MS),
            st.booleans(),
        ),
        max_size=200,
    )
)
def test_gate_is_deterministic_and_counts_every_cycle(cycles: list[Cycle]) -> None:
    """Two gates decide the same for any arguments."""
    one, other = LearningGate(MS), LearningGate(MS)

    assert reasons(one, iter(cycles), untouched) == reasons(other, iter(cycles), untouched)
    assert sum(one.counts.values()) == len(cycles)
