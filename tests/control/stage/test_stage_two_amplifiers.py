"""Tests of a stage with two amplifiers: a doubt about one output holds back its amplifier only."""

from collections.abc import Sequence
from math import nan
from typing import Any, cast

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.states import State
from piezod.control.in_force import OUTPUT_WAIT_S
from piezod.devices.interface import Capabilities, Device
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


class Unread:
    """A rig whose amplifier has no read-back: it repeats a value that tells nothing."""

    def __init__(self, inner: FaultyDevice) -> None:
        self.inner = inner

    def __getattr__(self, name: str) -> Any:
        """Leave everything else to the rig."""
        return getattr(self.inner, name)

    def capabilities(self) -> Capabilities:
        """Return those of the rig, without read-back."""
        return self.inner.capabilities()._replace(read_back=False)

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - asked for by Amplifier
        """Return a voltage that is not in force."""
        return [50.0]


class TwinStage(RigStage):
    """Such a stage, driven; its outputs and read-backs obey or not."""

    def __init__(self, *, unread_y: bool = False) -> None:
        self.rigs: list[Unruly] = []
        self.faulty: list[FaultyDevice] = []

        def wrapped(device: Device) -> Device:
            self.rigs.append(Unruly(cast("SensorAmplifier", device)))
            self.faulty.append(FaultyDevice(cast("SensorAmplifier", self.rigs[-1])))
            unread = unread_y and len(self.rigs) > 1
            return cast("Device", Unread(self.faulty[-1])) if unread else self.faulty[-1]

        super().__init__(twin_config(), wrapped)
        self.cycle()
        self.do(
            rq.Arm(confirm_output=unread_y),
            *(rq.Goto(axis=name, position_um=15.0) for name in ("x", "y")),
        )
        self.run(1.0)
        for rig in self.rigs:
            rig.steps_v.clear()


@pytest.mark.parametrize("lost", [True, False])
@pytest.mark.parametrize("stuck", [0, 1])
@pytest.mark.parametrize("request_", [rq.Stop(), rq.Estop()], ids=lambda each: each.kind)
@pytest.mark.few(3)
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


@pytest.mark.parametrize("watched", [0, 1])
def test_watchdog_of_one_amplifier_explains_no_fall_of_another(watched: int) -> None:
    """Each amplifier is asked for itself; a fall to neither 0 V nor rest is its watchdog's only."""
    stage = TwinStage()
    for i, rig in enumerate(stage.faulty):
        able = rig.capabilities()._replace(watchdog=i == watched)
        rig.capabilities = lambda able=able: able  # type: ignore[method-assign, misc] # of this one
    stage.stage.boundary.watchdog = stage.channels.watchdogs()
    stage.stage.judge.forget()  # what the sensors have shown
    fallen_v = [drive_v / 2.0 for drive_v in stage.stage.boundary.written_v]
    why, _ = stage.stage.judge.resync(fallen_v, stage.t_ns)

    assert stage.channels.watchdogs() == [watched == 0, watched == 1]
    assert (f"axis {'yx'[watched]}:" in why, f"axis {'xy'[watched]}:" in why) == (True, False)


@pytest.mark.fault("A3")
def test_amplifier_with_read_back_is_waited_for_beside_one_without() -> None:
    """Nothing is written far from its output; the other one is ramped down by its own writes."""
    stage = TwinStage(unread_y=True)
    rig, other = stage.rigs
    rig.obeys, before_v = False, rig.output_v
    step_v = stage.stage.axes[0].law.limits.slew_v_per_s * stage.period_ns / 1e9
    stage.do(rq.Stop())
    stage.run(RAMPED_S)

    assert rig.output_v == before_v
    assert max(rig.steps_v) <= step_v + stage.stage.axes[0].law.limits.read_back_tolerance_v
    assert other.output_v == pytest.approx(0.0, abs=1e-6)
    assert stage.state == State.RAMP
    stage.until("FAULT", OUTPUT_WAIT_S)
    assert "A3" in stage.faults()


@pytest.mark.fault("A1")
def test_only_a_read_back_that_an_amplifier_has_is_missing() -> None:
    """A stage goes on without the one that there is not, and is blind without the other."""
    stage = TwinStage(unread_y=True)
    goes_on = stage.state
    stage.rigs[0].reads = lambda _drive_v: nan
    stage.run(0.1)

    assert (goes_on, stage.state) == (State.RUN, State.BLIND)


def test_stage_is_armed_on_the_word_of_a_person_for_what_is_not_read_back_only() -> None:
    """The read-back that there is needs no word; one that is missing is not replaced by it."""
    stage = TwinStage(unread_y=True)
    stage.do(rq.Stop())
    stage.until("SAFE")
    again = stage.ask(rq.Arm())
    stage.do(rq.Stop())
    stage.until("SAFE")
    stage.rigs[0].reads = lambda _drive_v: nan
    stage.cycle()
    refused = stage.ask(rq.Arm(confirm_output=True))

    assert again.accepted  # its last write is known
    assert not refused.accepted


@pytest.mark.fault("A1")
@pytest.mark.parametrize("request_", [rq.Stop(), rq.Estop(), None], ids=["stop", "estop", "none"])
@pytest.mark.parametrize("gone", [0, 1])
def test_amplifier_that_stays_silent_keeps_no_other_one_from_its_ramp(
    gone: int, request_: rq.Request | None
) -> None:
    """Nothing is sent to it, not even when it answers again meanwhile; a person decides."""
    stage = TwinStage()
    rig, other = stage.rigs[gone], stage.rigs[1 - gone]
    rig.reads = lambda _drive_v: nan
    lost = Injection(InjectionKind.DROPPED, stage.t_ns + 1, stage.t_ns + 10**9)
    stage.faulty[gone].schedule.append(lost)
    stage.run(0.1)
    blind, before_v, n_lost = stage.state, rig.output_v, len(rig.steps_v)
    if request_:
        stage.do(request_)
    stage.until("RAMP" if request_ != rq.Estop() else "ESTOP", 3.0)
    rig.reads = lambda drive_v: drive_v
    stage.until("FAULT", 3.0)

    assert blind == State.BLIND
    assert (rig.output_v, other.output_v) == pytest.approx((before_v, 0.0), abs=1e-6)
    assert n_lost == len(rig.steps_v)
    name = "xy"[gone]
    assert [event.axis for event in stage.events if "the voltage stays" in event.text] == [name]
    stage.do(rq.Estop())
    stage.run(RAMPED_S)
    assert (rig.output_v, other.output_v) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert max(rig.steps_v) < before_v / 2


@pytest.mark.fault("A1")
def test_second_amplifier_that_is_lost_in_the_ramp_makes_the_stage_blind_again() -> None:
    """The ramp that leaves one as it is does not hide the loss of the other one."""
    stage = TwinStage()
    stage.rigs[0].reads = lambda _drive_v: nan
    stage.until("BLIND")
    stage.until("RAMP", 3.0)
    stage.rigs[1].reads = lambda _drive_v: nan
    stage.run(0.1)

    assert stage.state == State.BLIND
