"""The stage as the HTTP service sees it, with a loop without devices."""

import asyncio
from functools import partial
from math import nan
from pathlib import Path

import numpy as np
import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.states import State
from piezod.control.faults.table import FAULTS
from piezod.control.stage.answer import Answer
from piezod.daemon.stage import running_stage
from piezod.daemon.stage.errors import BadValueError, NotNowError, UnavailableError
from piezod.daemon.stage.peer import AuditEntry
from piezod.daemon.stage.running_stage import RunningStage
from piezod.messages.answers import Processor
from piezod.messages.requests import (
    Arm,
    Disarm,
    Estop,
    Goto,
    Hold,
    Request,
    Shutdown,
    Stop,
)
from piezod.messages.stores import Reloaded
from piezod.telemetry.stream import StreamReader
from piezod.telemetry.words import Word
from tests.daemon.bench import PEER, Bench


def test_status_before_the_first_cycle_has_no_numbers(bench: Bench) -> None:
    """Before the first cycle the state is BOOT, and the axes have no numbers."""
    status = bench.link.status()

    assert (status.stage, status.state, status.mode) == ("rig", "BOOT", "feedforward")
    assert (status.faults, status.skipped_cycles) == ((), 0)
    assert status.axes["x"].position_um is None
    assert bench.link.faults().faults == ()


@pytest.mark.parametrize(
    ("recorded", "newer", "shown"),
    [
        (State.RAMP, State.FAULT, "RAMP"),
        (None, State.FAULT, "BOOT"),
        (None, State.BLIND, "BLIND"),
    ],
)
def test_state_and_faults_are_of_one_cycle(
    bench: Bench, recorded: State | None, newer: State, shown: str
) -> None:
    """A state without its faults is not shown; without a record a loop starts or waits."""
    if recorded is not None:
        bench.record(recorded)
    bench.loop.shared.words[Word.LOOP_STATE] = list(State).index(newer)

    assert bench.link.status().state == shown


def test_status_is_that_of_the_newest_cycle(bench: Bench) -> None:
    """Status has position, command and drive of each axis, mode, and faults with a remedy."""
    last = len(FAULTS) - 1
    bench.record(
        State.RUN, 1 << last, position_um=3.0, command_um=3.1, drive_v=20.0, remaining_s=1.5
    )

    status = bench.link.status()

    axis = status.axes["x"]
    assert (axis.position_um, axis.command_um, axis.drive_v) == (3.0, 3.1, 20.0)
    assert (axis.motion, axis.on_target, axis.gate) == (4, True, "learning")
    assert (axis.remaining_s, axis.target_um) == (1.5, None)
    assert (status.state, status.mode) == ("RUN", "adaptive")
    assert [fault.id for fault in status.faults] == [FAULTS[last].id]
    assert status.faults == bench.link.faults().faults
    assert bench.link.fault_ids(1 << last) == [FAULTS[last].id]


def test_voltage_is_unknown_in_blind(bench: Bench) -> None:
    """In BLIND status has the read-back voltage, None without one, not the last written voltage."""
    bench.record(State.BLIND, drive_v=80.0)
    without = bench.link.status().axes["x"].drive_v
    bench.record(State.BLIND, drive_v=80.0, read_back_v=79.0)

    assert without is None
    assert bench.link.status().axes["x"].drive_v == 79.0


@pytest.mark.fault("L9")
def test_status_names_the_failed_real_time_steps(bench: Bench) -> None:
    """A failed step explains why arming is refused."""
    steps = [{"name": "memory", "ok": False}, {"name": "processor", "ok": True}]
    bench.loop.shared.set_report({"steps": steps, "devices": [{"name": "rig"}]})

    assert bench.link.status().not_realtime == ("memory",)
    assert bench.link.realtime().steps == tuple(steps)
    assert bench.link.realtime().devices == ({"name": "rig"},) == bench.link.status().devices


def test_status_names_the_processor(bench: Bench) -> None:
    """It is unknown until the loop has reported it."""
    before = bench.link.status().processor
    processor = {"number": 3, "shared_with": 1}
    bench.loop.shared.set_report({"steps": [], "devices": [], "processor": processor})

    assert before is None
    assert bench.link.status().processor == Processor(**processor)
    assert bench.link.status().rate_hz == bench.loop.config.rate_hz


def test_request_reaches_the_loop_and_its_answer_comes_back(bench: Bench) -> None:
    """The answer is that of the loop."""
    answer = bench.do(lambda link: link.request(Goto(position_um=4.0), PEER))

    assert answer == Answer(accepted=True, motion=7)
    assert bench.requests == [Goto(position_um=4.0)]


def test_shadow_makes_every_arming_a_shadow(tmp_path: Path, config: DaemonConfig) -> None:
    """With --shadow no client can have a voltage written."""
    bench = Bench(tmp_path, config, shadow=True)
    bench.do(lambda link: link.request(Arm(), PEER))
    bench.link.stage_audit.close()

    assert bench.requests == [Arm(shadow=True)]


def test_shutdown_is_for_the_supervisor(bench: Bench) -> None:
    """A shutdown does not go to the loop directly, which would then count as lost."""
    answer = bench.do(lambda link: link.request(Shutdown(), PEER))

    assert answer.accepted
    assert bench.requests == []
    assert bench.stopped == ["requested by somebody"]


async def _during_an_exchange(link: RunningStage, request: Request) -> Answer:
    """Send a request while there is no loop, and make the loop available later."""
    link.available = False
    asking = asyncio.create_task(link.request(request, PEER))
    await asyncio.sleep(0)  # the request has begun
    assert not link.health().healthy
    link.available = True
    return await asking


def test_requests_wait_for_the_end_of_an_exchange(bench: Bench) -> None:
    """A request during an exchange goes to the new loop, an emergency stop among them."""
    request: Request
    for request in (Goto(position_um=4.0), Estop()):
        answer = bench.do(partial(_during_an_exchange, request=request))
        assert answer.motion == 7
        assert bench.requests == [request]


def test_requests_are_refused_if_an_exchange_takes_too_long(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The client gets the reason before it gives up."""
    monkeypatch.setattr(running_stage, "EXCHANGED_WITHIN_S", 0.0)
    bench.link.available = False

    with pytest.raises(UnavailableError, match="being exchanged"):
        bench.do(lambda link: link.request(Goto(position_um=4.0), PEER))


@pytest.mark.parametrize("request_", [Stop(), Hold(), Disarm()])
def test_stop_is_answered_at_once_during_an_exchange(bench: Bench, request_: Request) -> None:
    """An exchange drives nothing: there is nothing to stop, and no loop to ask."""
    bench.link.available = False

    assert bench.do(lambda link: link.request(request_, PEER)).accepted
    assert bench.requests == []


def test_setpoints_of_a_stream_arrive_together_or_not_at_all(bench: Bench) -> None:
    """A setpoint out of range is refused with the range; outside RUN all are refused."""
    reader = StreamReader(bench.loop.shared)
    with pytest.raises(NotNowError, match="the stage is in BOOT"):
        bench.link.stream_setpoint({"x": 3.0})
    bench.record(State.RUN)
    with pytest.raises(BadValueError, match=r"got 26\.5 µm"):
        bench.link.stream_setpoint({"x": 26.5})
    with pytest.raises(BadValueError, match="got nan"):
        bench.link.stream_setpoint({"x": nan})

    bench.link.stream_setpoint({"x": 3.0})

    assert [setpoint.position_um for setpoint in reader.take()] == [3.0]


def test_readers_follow_an_exchanged_loop(bench: Bench) -> None:
    """After an exchange a reader reads the ring of the new loop."""
    reader = bench.link.open_reader()
    bench.record(State.SAFE)
    before, _ = reader.read(10)
    bench.loop = bench.link.loop = bench.connection()
    reader.read(10)
    bench.record(State.SAFE)
    after, lost = reader.read(10)

    assert (len(before), len(after), lost) == (1, 1, 0)
    assert np.isnan(after["axes"]["position_um"]).all()


def test_audit_is_read_newest_first(bench: Bench) -> None:
    """The newest entry comes first."""
    bench.link.audit(AuditEntry(PEER, "arm", accepted=True))
    bench.link.audit(AuditEntry(PEER, "goto", accepted=False, why="cannot"))

    entries = asyncio.run(bench.link.audit_log(10)).audit

    assert [(entry.what, entry.why) for entry in entries] == [("goto", "cannot"), ("arm", "")]


def test_configuration_and_reload_are_passed_on(bench: Bench) -> None:
    """The configuration in force is returned as JSON."""
    assert bench.link.config()["rate_hz"] == 20
    assert bench.link.config()["longest_move_s"]["x"] == 0.5  # ten cycles, longer than its way
    assert asyncio.run(bench.link.reload(PEER)) == Reloaded(("by somebody",))
    assert bench.link.realtime().rate_hz == 20
