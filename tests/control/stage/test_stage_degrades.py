"""Tests of faults after which a stage runs on in feedforward, from the cause to that mode."""

from collections import deque
from collections.abc import Sequence
from typing import cast

import numpy as np
import pytest

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.trim import TrimConfig
from piezod.control.faults.detection import Detection
from piezod.control.watch.loop import CycleTiming
from piezod.devices.interface import Sample
from piezod.messages import requests as rq
from piezod.telemetry.record import CycleRecord
from piezod.testing.faulty import FaultyDevice, SensorAmplifier
from piezod.testing.injections import InjectionKind
from tests.conftest import Reaction
from tests.control.fault_cases import SwingingStage
from tests.control.rig_stage import FaultyStage, RigStage, cycles_until, quick_config, with_axis
from tests.control.surface_rig import CLASSES, with_model

PUNCTUAL = CycleTiming(0, 0, 10_000, 0, 0)
LATE = CycleTiming(3_000_000, 0, 10_000, 0, 0)
LAG_CYCLES = 12


def is_degraded(record: CycleRecord) -> bool:
    """Return whether the axis is in feedforward."""
    return record.axes[0].mode is Mode.FEEDFORWARD


def check_degraded(stage: RigStage, after: list[CycleRecord], fault: Fault) -> int:
    """Check that one fault alone led to feedforward, for good, in RUN; return its cycle."""
    first = cycles_until(after, is_degraded)
    assert set(stage.faults()) == {fault}
    assert {record.state for record in after} == {State.RUN}
    assert all(map(is_degraded, after[first - 1 :]))
    return first


@pytest.mark.fault("S12")
def test_noisy_sensor_leads_to_feedforward(reaction: Reaction) -> None:
    """The axis follows in feedforward, where the noise does not reach the drive."""
    stage = SwingingStage(rate_hz=1000.0)
    stage.run(5.0)  # by then the usual noise is known
    stage.fail(InjectionKind.NOISE, value=0.3)
    after = stage.run(2.0)

    reaction("S12", cycles=check_degraded(stage, after, Fault.S12))
    assert np.diff([record.axes[0].drive_v for record in after[-1000:]]).max() < 1.5


@pytest.mark.fault("L7")
def test_strict_loop_that_is_often_late_leads_to_feedforward(reaction: Reaction) -> None:
    """One cycle in eighty begins late; with `strict_rt` a person ends the fault."""
    stage = SwingingStage(strict_rt=True, rate_hz=1000.0)
    after = [stage.cycle(PUNCTUAL if k % 80 else LATE) for k in range(9000)]

    reaction("L7", cycles=check_degraded(stage, after, Fault.L7))
    assert not stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE)).accepted


@pytest.mark.fault("L7")
def test_loop_that_is_often_late_leads_to_a_warning() -> None:
    """Without `strict_rt` the stage goes on in its mode."""
    stage = SwingingStage()
    after = [stage.cycle(PUNCTUAL if k % 80 else LATE) for k in range(1000)]

    assert stage.faults() == [Fault.L7]
    assert {(record.state, record.axes[0].mode) for record in after} == {(State.RUN, Mode.ADAPTIVE)}


class LaggingSensor(FaultyDevice):
    """A rig whose samples can be twelve periods older than their time stamps."""

    def __init__(self, device: SensorAmplifier) -> None:
        super().__init__(device)
        self.lags = False
        self._last = deque([Sample(0, 0.0, False)] * LAG_CYCLES, LAG_CYCLES)

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return a sample, with the position of an older one if it lags."""
        (sample,) = super().read(now_ns)
        older = self._last[0]
        self._last.append(sample)
        return [sample._replace(position_um=older.position_um) if self.lags else sample]


def trimmed_stage(model: str) -> tuple[RigStage, LaggingSensor]:
    """Return a stage that rests at 12 µm, with a trim that is stable unless the sensor lags."""
    config = with_model(quick_config(), model)
    trim = TrimConfig(gain_per_s=270.0, authority_pct=2.0)
    quick = with_axis(config, trim=trim).model_copy(update={"rate_hz": 1000.0})
    stage = FaultyStage(quick, faulty=LaggingSensor)
    stage.armed(rq.SelectMode(mode=Mode.TRIMMED), rq.Goto(position_um=12.0))
    stage.run(0.5)
    assert stage.faults() == []
    return stage, cast("LaggingSensor", stage.device)


@pytest.mark.fault("D6")
@pytest.mark.parametrize("model", CLASSES)
def test_oscillating_stage_is_warned_of_and_then_led_to_feedforward(
    model: str, reaction: Reaction
) -> None:
    """A delay that the configuration does not name makes the trim oscillate.

    With half its gain it still does. In feedforward the oscillation ends, so that HOLD does not
    follow.
    """
    stage, sensor = trimmed_stage(model)
    trim, before_ns = stage.stage.axes[0].law.trim, stage.t_ns
    sensor.lags = True
    after = stage.run(0.65)
    halved = trim.gain_halved, stage.x.mode
    after += stage.run(1.0)

    reaction("D6", cycles=stage.cycles_to(Fault.D6, before_ns))
    assert halved == (True, Mode.TRIMMED)
    assert check_degraded(stage, after, Fault.D6) == stage.cycles_to(Fault.D6, before_ns) + 500
    assert np.ptp([record.axes[0].position_um for record in after[-500:]]) < 0.3


@pytest.mark.fault("D6")
def test_oscillation_that_does_not_end_in_feedforward_holds() -> None:
    """The detection is injected in each cycle: in feedforward nothing feeds an oscillation."""
    stage = SwingingStage(Mode.TRIMMED)
    after = []
    for _ in range(202):
        stage.controller.report(Detection(Fault.D6, 0))
        after.append(stage.cycle())

    states = [record.state for record in after]
    assert 100 <= cycles_until(after, is_degraded) <= 102
    assert 200 <= states.index(State.HOLD) <= 201
    assert set(states[:200]) == {State.RUN}
    assert stage.state == State.HOLD
