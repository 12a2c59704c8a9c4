"""Tests of a stage with two amplifiers: a doubt about one output holds back its amplifier only."""

from typing import cast

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.states import State
from piezod.control.in_force import OUTPUT_WAIT_S
from piezod.devices.interface import Device
from piezod.messages import requests as rq
from piezod.testing.faulty import FaultyDevice, SensorAmplifier
from piezod.testing.injections import Injection, InjectionKind
from tests.control.rig_stage import RigStage, quick_config
from tests.control.stage.test_stage_output import Unruly

RAMPED_S = 2.0
"""Either axis is ramped down in less than this."""


def twin_config() -> DaemonConfig:
    """Return a stage of two axes, each with an amplifier of its own."""
    config = quick_config()
    x, rig = config.axes["x"], config.devices["rig"]
    axes = {
        name: x.model_copy(
            update={
                "amplifier": x.amplifier.model_copy(update={"device": f"{name} rig"}),
                "sensor": x.sensor and x.sensor.model_copy(update={"device": f"{name} rig"}),
            }
        )
        for name in ("x", "y")
    }
    devices = {f"{name} rig": rig for name in axes}
    return config.model_copy(update={"axes": axes, "devices": devices})


class TwinStage(RigStage):
    """Such a stage, driven; its outputs and read-backs obey or not.

    Attributes:
        rigs: The rigs of x and y.
        faulty: The same rigs, each of which may be lost.
    """

    def __init__(self) -> None:
        self.rigs: list[Unruly] = []
        self.faulty: list[FaultyDevice] = []

        def wrapped(device: Device) -> Device:
            self.rigs.append(Unruly(cast("SensorAmplifier", device)))
            self.faulty.append(FaultyDevice(cast("SensorAmplifier", self.rigs[-1])))
            return self.faulty[-1]

        super().__init__(twin_config(), wrapped)
        self.cycle()
        self.do(rq.Arm(), *(rq.Goto(axis=name, position_um=15.0) for name in ("x", "y")))
        self.run(1.0)
        for rig in self.rigs:
            rig.steps_v.clear()


@pytest.mark.parametrize("lost", [True, False])
@pytest.mark.parametrize("stuck", [0, 1])
@pytest.mark.parametrize("request_", [rq.Stop(), rq.Estop()], ids=lambda each: each.kind)
def test_output_that_does_not_follow_keeps_no_other_amplifier_from_its_ramp(
    stuck: int, lost: bool, request_: rq.Request
) -> None:
    """The other one is at its safe voltage at once; this one when it follows again."""
    stage = TwinStage()
    rig, other = stage.rigs[stuck], stage.rigs[1 - stuck]
    rig.obeys = False
    if lost:  # not even the last write is near the read-back, and no sensor tells
        rig.reads = lambda drive_v: drive_v + 20.0
        dropped = Injection(InjectionKind.DROPPED, stage.t_ns + 1)
        stage.faulty[stuck].schedule.append(dropped)
    before_v = rig.output_v
    stage.do(request_)
    stage.run(RAMPED_S)
    waited_v = rig.output_v, other.output_v
    rig.obeys, rig.reads = True, lambda drive_v: drive_v
    stage.until("FAULT")  # a person looks at what A3 has stopped

    assert waited_v == pytest.approx((before_v, 0.0), abs=1e-6)
    assert rig.output_v == other.output_v == pytest.approx(0.0, abs=1e-6)


def test_ramp_that_still_goes_on_is_not_ended_by_one_that_waits() -> None:
    """The stage gives up when no axis is on its way any more."""
    stage = TwinStage()
    slow = stage.stage.axes[1]
    slow.config = slow.config.model_copy(
        update={"safety": slow.config.safety.model_copy(update={"ramp_v_per_s": 1.8})}
    )
    stage.rigs[0].obeys = False
    way_s = stage.rigs[1].output_v / 1.8
    stage.do(rq.Stop())
    stage.until("FAULT", within_s=OUTPUT_WAIT_S + way_s)

    assert way_s > OUTPUT_WAIT_S
    assert stage.rigs[1].output_v == pytest.approx(0.0, abs=1e-6)
    assert [event.axis for event in stage.events if "the voltage stays" in event.text] == ["x"]


@pytest.mark.fault("A7")
def test_lost_amplifier_with_an_unknown_voltage_keeps_no_other_one_from_its_ramp() -> None:
    """Nothing is written to it; the other one is ramped down."""
    stage = TwinStage()
    before_v, n_before = stage.rigs[0].output_v, len(stage.rigs[0].steps_v)
    for kind in (InjectionKind.READ_BACK_OFFSET, InjectionKind.DROPPED):
        injection = Injection(kind, stage.t_ns + 1, value=-before_v)
        stage.faulty[0].schedule.append(injection)
    stage.cycle()
    blind = stage.state
    stage.run(RAMPED_S)

    assert blind == State.BLIND
    assert stage.rigs[1].output_v == pytest.approx(0.0, abs=1e-6)
    assert (stage.rigs[0].output_v, len(stage.rigs[0].steps_v)) == (before_v, n_before)
    stage.until("FAULT", OUTPUT_WAIT_S)
    assert stage.rigs[0].output_v == before_v
