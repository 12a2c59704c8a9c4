"""Tests of ramps that begin where the output of the amplifier is, not where it was told to be."""

from math import nan

import pytest

from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.control.watch.loop import CycleTiming
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.testing.injections import InjectionKind
from tests.control.fault_cases import SwingingStage


def fell_during_a_pause(flag: DeviceFlag | None = None) -> SwingingStage:
    """Return a stage whose output fell from about 13 V to 0 V during a pause of 4 s."""
    stage = SwingingStage()
    while not 12.0 < stage.x.drive_v < 15.0:
        stage.cycle()
    stage.device.deactivate(stage.t_ns)
    stage.device.activate(stage.t_ns)
    if flag is not None:
        stage.fail(InjectionKind.FLAGGED, 805, flag=flag)
    stage.channels.writes.clear()
    stage.cycle(CycleTiming(0, 800, 10_000, 0, 0))
    return stage


@pytest.mark.fault("A9")
def test_tripped_watchdog_is_reported_and_the_ramp_starts_at_the_output() -> None:
    """This holds for any fall of the output: no write is near the old voltage."""
    stage = fell_during_a_pause(DeviceFlag.WATCHDOG_TRIPPED)
    blind, sent = stage.state, len(stage.channels.writes)
    stage.until("RAMP")
    stage.run(1.0)

    assert Fault.A9 in stage.faults()
    assert (blind, sent) == (State.BLIND, 0)
    assert max(drive_v for _, (drive_v,) in stage.channels.writes) < 0.8
    assert stage.state == State.FAULT


@pytest.mark.fault("A9")
def test_watchdog_that_stays_tripped_does_not_prevent_the_ramp() -> None:
    """Many amplifiers report it until they take a write: the ramp starts after the first wait."""
    stage = SwingingStage()
    stage.fail(InjectionKind.FLAGGED, None, flag=DeviceFlag.WATCHDOG_TRIPPED)
    stage.until("RAMP", within_s=0.2)
    stage.until("FAULT")

    assert stage.faults().count(Fault.A9) == 1
    assert stage.x.drive_v == pytest.approx(0.0, abs=5e-3)


@pytest.mark.fault("A7")
def test_ramp_starts_where_the_output_has_fallen() -> None:
    """Only the read-back shows the fall, which is smaller than a collapse."""
    stage = fell_during_a_pause()
    state = stage.state
    stage.run(1.0)

    assert state == State.BLIND
    assert Fault.A7 in stage.faults()
    assert max(drive_v for _, (drive_v,) in stage.channels.writes) < 0.8


@pytest.mark.parametrize("off_v", [30.0, -4.0, nan])
def test_no_ramp_starts_with_a_step_up(off_v: float) -> None:
    """A single wrong read-back, or a missing one, does not change the start of the ramp."""
    stage = SwingingStage()
    before_v = stage.x.drive_v
    stage.fail(InjectionKind.READ_BACK_OFFSET, 1, value=off_v)
    stage.cycle()
    last_v = stage.x.drive_v
    stage.ask(rq.Stop())

    assert stage.state == State.RAMP
    assert abs(last_v - before_v) < 5.0
    assert last_v - 1.1 < stage.x.drive_v <= last_v
