"""Tests of a start after a killed daemon or another loop, and of the causes of states."""

from math import nan

import pytest

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.faults.table import mask
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.testing.injections import InjectionKind
from tests.control.rig_stage import FaultyStage, RigStage


def running() -> RigStage:
    """Return a stage that holds a position."""
    stage = RigStage().armed(rq.Goto(position_um=12.0))
    stage.run(0.5)
    return stage


def test_refusal_says_how_the_state_came_about() -> None:
    """The cause goes on from RAMP to SAFE; a fault and a request are named, each with its time."""
    stage = running()
    stage.controller.report(Detection(Fault.L5))
    stage.until("SAFE")
    stage.run(3.0)
    after_fault = stage.ask(rq.Goto(position_um=1.0)).why
    stopped = running()
    stopped.do(rq.Stop())
    stopped.until("SAFE")
    after_stop = stopped.ask(rq.Resume()).why
    held = stopped.ask(rq.Hold())

    assert after_fault == "cannot move in SAFE: `piezod arm` first (in SAFE for 3 s because of L5)"
    assert "(in SAFE for 0 s because of `stop`)" in after_stop
    assert (held.accepted, held.why.partition(" (")[0]) == (
        False,
        "cannot hold in SAFE: nothing is driven",
    )


@pytest.mark.fault("P2")
@pytest.mark.parametrize("left_v", [80.0, 0.0])
@pytest.mark.parametrize("cycles_before", [0, 5])
def test_voltage_of_a_killed_daemon_is_ramped_down(left_v: float, cycles_before: int) -> None:
    """The ramp starts at the read-back and ends in FAULT; at the safe voltage there is none."""
    stage = RigStage()
    stage.channels.write([left_v], 0)
    stage.t_ns += 50_000_000  # the output settles before the first cycle
    stage.channels.writes.clear()
    stage.controller.stay_in_boot(True)
    for _ in range(cycles_before):  # by which the loop process measures their duration
        stage.cycle()
    stage.controller.report(Detection(Fault.P2))
    stage.controller.ramp_first()
    stage.controller.stay_in_boot(False)
    stage.cycle()
    stage.until("FAULT")
    stage.run(0.1)

    assert stage.output_v == pytest.approx(0.0, abs=0.5)
    assert bool(stage.channels.writes) is (left_v > 0.0)
    assert all(
        first_v == pytest.approx(left_v, abs=0.5) for _, (first_v,) in stage.channels.writes[:1]
    )
    assert not stage.ask(rq.Arm()).accepted


def test_faults_of_the_loop_before_stop_the_stage() -> None:
    """A stage that takes over a latched fault is in FAULT at once, and a reset ends it."""
    stage = RigStage()
    stage.controller.stay_in_boot(True)
    stage.run(0.1)
    measured = stage.state
    stage.controller.restore_faults(mask([Fault.E1]), stopped=True)
    stage.controller.stay_in_boot(False)
    stage.cycle()
    state = stage.state
    refused = stage.ask(rq.Arm())
    stage.run(1.5)
    stage.do(rq.Reset(), rq.Arm())

    assert (measured, state, refused.accepted) == ("BOOT", "FAULT", False)


@pytest.mark.fault("P2")
def test_amplifier_that_answers_late_is_ramped_down() -> None:
    """An amplifier of a daemon that was killed is ramped down as soon as it has a read-back."""
    stage = FaultyStage()
    stage.channels.write([80.0], 0)
    stage.t_ns += 50_000_000
    stage.controller.stay_in_boot(True)
    stage.cycle()
    stage.fail(InjectionKind.LOST, 200, flag=DeviceFlag.DISCONNECTED)
    stage.run(0.1)
    lost = stage.state
    stage.controller.report(Detection(Fault.P2))
    stage.controller.ramp_first()
    stage.controller.stay_in_boot(False)
    stage.until("FAULT", 20.0)

    assert lost == "BLIND"
    assert stage.output_v == pytest.approx(0.0, abs=0.5)


@pytest.mark.fault("P2")
def test_amplifier_that_was_found_at_rest_is_only_observed_later() -> None:
    """A loss in SAFE, long after the start, writes nothing when the amplifier is back."""
    stage = FaultyStage()
    stage.controller.ramp_first()
    stage.run(0.1)
    stage.fail(InjectionKind.LOST, 200, flag=DeviceFlag.DISCONNECTED)
    stage.until("BLIND")
    stage.run(5.0)

    assert stage.state in {"SAFE", "FAULT"}
    assert stage.channels.writes == []


@pytest.mark.parametrize(("noted_v", "accepted"), [(30.0, False), (0.0, True), (nan, True)])
def test_word_of_a_person_is_not_believed_against_the_last_write(
    noted_v: float, accepted: bool
) -> None:
    """Without a read-back the first write would be a step to the safe voltage; the note is told."""
    stage = RigStage(reads_back=False, holds=True)
    stage.controller.know_last_writes([noted_v])
    stage.cycle()
    unconfirmed, confirmed = stage.ask(rq.Arm()), stage.ask(rq.Arm(confirm_output=True))

    assert (unconfirmed.accepted, confirmed.accepted) == (False, accepted)
    assert bool(stage.channels.writes) is accepted
    for answer in (unconfirmed,) if accepted else (unconfirmed, confirmed):
        assert ("30 V" in answer.why, "`piezod safe CONFIG`" in answer.why) == (not accepted,) * 2
