"""Tests of learning on a made-up stage: creep, drift, and samples that are not learned from."""

from collections.abc import Callable

import numpy as np
import pytest

from piezod.config.gate_reasons import GateReason
from piezod.control.law.compensator import DriveHistory
from piezod.control.law.creep import AT_REST, CreepState
from piezod.control.law.identifier import Identifier, LearningGate
from piezod.devices.interface import Sample
from piezod.hysteresis import (
    AdaptiveIdentifier,
    AffineRange,
    Convergence,
    LMSIdentifier,
    RLSIdentifier,
)
from tests.control.fakes import MS
from tests.control.made_up import BANK, CREEP, WEIGHTS, Array, MadeUpStage, inverse, wander

UNIT = AffineRange(0.0, 1.0)
START = CreepState(CREEP, np.zeros(3), 0.0, 0.0)

Spoil = Callable[[Sample], Sample]


class Bench:
    """A stage that its own inverse model drives, with an identifier."""

    def __init__(
        self, adaptation: AdaptiveIdentifier, stage: MadeUpStage, creep: CreepState = START
    ) -> None:
        self.adaptation, self.stage = adaptation, stage
        self.history = DriveHistory(0.0, entries=8)
        self.inverse = inverse()
        self.gate = LearningGate(MS)
        self.identifier = Identifier(
            adaptation, UNIT, UNIT, self.history, 0, MS, Convergence(0.01, 100), self.gate, creep
        )
        self.t_ns = 0

    def run(
        self,
        quick: Array,
        drift: float = 0.0,
        *,
        spoil: Spoil | None = None,
        limited: bool = False,
    ) -> None:
        """Drive displacements without creep; the sensor drifts by `drift` per sample."""
        for y in quick:
            self.t_ns += MS
            drive = self.inverse.step(y)
            self.history.append(self.t_ns, drive)
            position = self.stage.step(drive) + drift * self.t_ns / MS
            sample = Sample(self.t_ns, position, valid=True)
            self.identifier.learn(
                self.t_ns, spoil(sample) if spoil else sample, limited=limited, expected=y
            )


def rls(weights: Array = WEIGHTS) -> RLSIdentifier:
    """Return an algorithm that learns fast."""
    return RLSIdentifier(BANK, weights)


def test_creep_is_removed_before_learning() -> None:
    """An identifier that knows the creep learns no other weights from it."""
    known, unaware = Bench(rls(), MadeUpStage()), Bench(rls(), MadeUpStage(), AT_REST)

    for bench in (known, unaware):
        bench.run(wander(5.0))

    assert known.adaptation.weights == pytest.approx(WEIGHTS, abs=1e-9)
    assert known.adaptation.offset == pytest.approx(0.0, abs=1e-9)
    assert np.max(np.abs(unaware.adaptation.weights - WEIGHTS)) > 1e-3


def test_creep_before_the_sensor_zero_is_taken_into_account() -> None:
    """The samples lack the creep at the zero, and its decay has the other sign."""
    lags = np.array([0.1, 0.2, 0.3])
    zeroed = float(CREEP.weights @ lags)
    bench = Bench(rls(), MadeUpStage(lags=lags), CreepState(CREEP, lags, zeroed, 0.0))

    bench.run(wander(5.0), spoil=lambda s: s._replace(position_um=s.position_um - zeroed))

    assert bench.adaptation.weights == pytest.approx(WEIGHTS, abs=1e-9)


def test_creep_advances_while_samples_are_missing() -> None:
    """After half a second without samples at standstill the pairs still fit."""
    bench = Bench(rls(), MadeUpStage())
    there = wander(1.7)
    bench.run(there)

    bench.run(np.full(500, there[-1]), spoil=lambda s: s._replace(valid=False))
    bench.run(there[::-1])

    assert bench.adaptation.weights == pytest.approx(WEIGHTS, abs=1e-6)


@pytest.mark.parametrize(
    ("reason", "spoil", "limited"),
    [
        (GateReason.INVALID, lambda s: s._replace(valid=False), False),
        (GateReason.INVALID, lambda s: s._replace(position_um=float("nan")), False),
        (GateReason.LATE, lambda s: s._replace(t_ns=s.t_ns - 3 * MS), False),
        (GateReason.LIMITED, lambda s: s, True),
    ],
    ids=["invalid", "not a number", "late", "limited"],
)
def test_unusable_samples_change_no_weights(
    reason: GateReason, spoil: Spoil, limited: bool
) -> None:
    """Weights and offset stay the same to the bit, for any displacement."""
    bench = Bench(rls(1.3 * WEIGHTS), MadeUpStage())
    bench.run(wander(2.0))
    weights, offset = bench.adaptation.weights.copy(), bench.adaptation.offset

    bench.run(0.5 * wander(1.0), 1e-5, spoil=spoil, limited=limited)

    assert bench.gate.reason is reason
    assert bench.adaptation.weights.tolist() == weights.tolist()
    assert bench.adaptation.offset == offset


def test_memory_advances_while_nothing_is_learned() -> None:
    """After motion at the slew rate the pairs fit at once: the memory has every loop."""
    bench = Bench(rls(), MadeUpStage())
    bench.run(wander(1.0))
    bench.run(0.5 * wander(1.8), limited=True)

    bench.run(0.5 * wander(1.8)[::-1])

    assert bench.gate.counts[GateReason.LIMITED] > 1800
    assert bench.adaptation.weights == pytest.approx(WEIGHTS, abs=1e-9)


def test_memory_advances_while_samples_are_missing() -> None:
    """After turns without samples the pairs fit at once: the memory has every turn."""
    bench = Bench(rls(), MadeUpStage())
    bench.run(wander(1.0))
    bench.run(wander(2.8)[1000:], spoil=lambda s: s._replace(valid=False))

    bench.run(wander(2.8)[::-1])

    assert bench.gate.counts[GateReason.INVALID] == 1800
    assert bench.adaptation.weights == pytest.approx(WEIGHTS, abs=1e-6)


def test_spike_does_not_enter_the_memory() -> None:
    """A single sample at the end of the range would erase all loops."""
    bench = Bench(rls(), MadeUpStage())
    there = 0.5 * wander(3.3)
    bench.run(there[:3200])

    bench.run(there[3200:3201], spoil=lambda s: s._replace(position_um=0.99))
    bench.run(there[3201:])
    bench.run(there[::-1])

    assert bench.gate.counts[GateReason.SPIKE] >= 1
    assert bench.adaptation.weights == pytest.approx(WEIGHTS, abs=1e-6)


def test_offset_follows_the_drift_of_the_sensor() -> None:
    """RLS learns a drift of 1 % in ten seconds as the offset, and keeps the weights."""
    bench = Bench(rls(), MadeUpStage())

    bench.run(wander(10.0), 1e-6)

    assert bench.identifier.offset == pytest.approx(0.01, abs=3e-4)
    assert bench.adaptation.weights == pytest.approx(WEIGHTS, abs=2e-3)


def test_scale_follows_the_gain_of_the_stage() -> None:
    """The creep scales with the gain: with the right scale, weights and offset stay."""
    bench = Bench(rls(), MadeUpStage())
    bench.adaptation.adopt(WEIGHTS, 0.0, 1.0 / 1.1 - 1.0)

    bench.run(wander(10.0), spoil=lambda s: s._replace(position_um=1.1 * s.position_um))

    assert bench.identifier.scale == pytest.approx(1.0 / 1.1 - 1.0, abs=1e-9)
    assert bench.identifier.offset == pytest.approx(0.0, abs=1e-9)
    assert bench.adaptation.weights == pytest.approx(WEIGHTS, abs=1e-9)


def test_lms_learns_no_offset() -> None:
    """LMS puts a drift into the weights, as in the paper."""
    bench = Bench(LMSIdentifier(BANK), MadeUpStage())

    bench.run(wander(1.0), 1e-6)

    assert bench.identifier.offset == 0.0
