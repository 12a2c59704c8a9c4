"""The stage as the HTTP service sees it, with a loop without devices."""

import asyncio
from collections.abc import Iterator
from functools import partial
from math import isnan, nan
from pathlib import Path

import numpy as np
import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.faults import Fault
from piezod.config.requests import (
    AdoptModel,
    Arm,
    Disarm,
    Estop,
    Goto,
    Hold,
    Request,
    Shutdown,
    Stop,
)
from piezod.config.states import State
from piezod.control.faults.table import FAULTS, mask
from piezod.control.stage.answer import Answer
from piezod.daemon.loop import accept
from piezod.daemon.service.stage_service import (
    AuditEntry,
    BadValueError,
    NotNowError,
    UnavailableError,
    UnknownNameError,
)
from piezod.daemon.supervisor import stage_link
from piezod.daemon.supervisor.stage_link import StageLink
from piezod.telemetry.learned import LearnedWriter
from piezod.telemetry.stream import StreamReader
from piezod.telemetry.words import SUPERVISOR_FAULTS, Word
from tests.daemon.bench import PEER, Bench


@pytest.fixture
def config(rig_file: Path) -> DaemonConfig:
    """Return the configuration of a simulated stage."""
    return accept.load(rig_file)


@pytest.fixture
def bench(tmp_path: Path, config: DaemonConfig) -> Iterator[Bench]:
    """Return a link to test."""
    bench = Bench(tmp_path, config)
    yield bench
    bench.link.stage_audit.close()


def test_status_before_the_first_cycle_has_no_numbers(bench: Bench) -> None:
    """Before the first cycle the state is BOOT, and the axes have NaN."""
    status = bench.link.status()

    assert (status["stage"], status["state"], status["mode"]) == ("rig", "BOOT", "feedforward")
    assert (status["faults"], status["skipped_cycles"]) == ([], 0)
    assert isnan(status["axes"]["x"]["position_um"])
    assert bench.link.faults() == []


def test_status_is_that_of_the_newest_cycle(bench: Bench) -> None:
    """Status has position, command and drive of each axis, mode, and faults with a remedy."""
    last = len(FAULTS) - 1
    bench.record(State.RUN, 1 << last, position_um=3.0, command_um=3.1, drive_v=20.0)

    status = bench.link.status()

    axis = status["axes"]["x"]
    assert (axis["position_um"], axis["command_um"], axis["drive_v"]) == (3.0, 3.1, 20.0)
    assert (axis["motion"], axis["on_target"], axis["gate"]) == (4, True, "learning")
    assert (status["state"], status["mode"]) == ("RUN", "adaptive")
    assert [fault["id"] for fault in status["faults"]] == [FAULTS[last].id]
    assert status["faults"] == bench.link.faults()
    assert bench.link.fault_ids(1 << last) == [FAULTS[last].id]


def test_voltage_is_unknown_in_blind(bench: Bench) -> None:
    """In BLIND status has the read-back voltage, NaN without one, not the last written voltage."""
    bench.record(State.BLIND, drive_v=80.0)
    without = bench.link.status()["axes"]["x"]["drive_v"]
    bench.record(State.BLIND, drive_v=80.0, read_back_v=79.0)

    assert isnan(without)
    assert bench.link.status()["axes"]["x"]["drive_v"] == 79.0


@pytest.mark.fault("L9")
def test_status_names_the_failed_real_time_steps(bench: Bench) -> None:
    """A failed step explains why arming is refused."""
    steps = [{"name": "memory", "ok": False}, {"name": "processor", "ok": True}]
    bench.loop.shared.set_report({"steps": steps, "devices": [{"name": "rig"}]})

    assert bench.link.status()["not_realtime"] == ["memory"]
    assert bench.link.realtime()["steps"] == steps
    assert bench.link.realtime()["devices"] == [{"name": "rig"}] == bench.link.status()["devices"]


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


async def _during_an_exchange(link: StageLink, request: Request) -> Answer:
    """Send a request while there is no loop, and make the loop available later."""
    link.available = False
    asking = asyncio.create_task(link.request(request, PEER))
    await asyncio.sleep(0)  # the request has begun
    assert not link.health()[0]
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
    monkeypatch.setattr(stage_link, "EXCHANGED_WITHIN_S", 0.0)
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


def _learn(bench: Bench, zero_um: float) -> list[float]:
    model = bench.loop.models["x"]
    assert model is not None
    weights = [1.01 * each for each in (*model.left_stop_weights, *model.right_stop_weights)]
    LearnedWriter(bench.loop.shared).publish(0, weights, 0.0, 0.0, zero_um)
    return weights


def test_saved_parameters_are_loaded(bench: Bench) -> None:
    """The learned weights become a model again, with the sensor zero."""
    weights = _learn(bench, zero_um=0.25)
    saved = bench.do(lambda link: link.save_params(PEER))
    history = bench.do(lambda link: link.params_history())
    loaded = bench.do(lambda link: link.load_params(None, PEER))

    (request,) = bench.requests
    assert isinstance(request, AdoptModel)
    assert request.zero_um == 0.25
    assert saved["sequence"] == loaded["sequence"] == 1
    assert [entry["saved_by"] for entry in history] == ["somebody"]
    model = bench.loop.models["x"]
    assert model is not None
    assert [*model.left_stop_weights, *model.right_stop_weights] == pytest.approx(weights)
    assert asyncio.run(bench.link.params())["axes"]["x"]["zero_um"] == 0.25


def test_parameters_beyond_their_range_are_not_saved(bench: Bench) -> None:
    """Parameters that could not be loaded again are refused, and older ones stay."""
    _learn(bench, zero_um=1e9)

    with pytest.raises(NotNowError, match=r"not saved: (?s:.*)zero_um"):
        bench.do(lambda link: link.save_params(PEER))


def test_parameters_that_the_loop_refuses_are_not_in_use(bench: Bench) -> None:
    """The client gets the reason of the loop."""
    _learn(bench, zero_um=0.0)
    bench.do(lambda link: link.save_params(PEER))
    before = bench.loop.models["x"]

    with pytest.raises(NotNowError, match="axis x: only while disarmed"):
        bench.do(lambda link: link.load_params(1, PEER), Answer(False, "only while disarmed"))

    assert bench.loop.models["x"] is before


@pytest.mark.fault("D8")
def test_corrupt_parameters_are_skipped_and_reported(bench: Bench) -> None:
    """Older parameters are loaded, and the answer names the rejected files."""
    _learn(bench, zero_um=0.0)
    for _ in range(2):
        bench.do(lambda link: link.save_params(PEER))
    newest = max(bench.paths.parameters.glob("*.json"))
    newest.write_bytes(newest.read_bytes()[:-9])

    loaded = bench.do(lambda link: link.load_params(None, PEER))

    assert (loaded["sequence"], loaded["copy"]) == (1, "number 1")
    assert [each["file"] for each in loaded["rejected"]] == [newest.name]


def _reported(bench: Bench) -> list[Fault]:
    """Return the faults that the supervisor reports to the loop."""
    bench.link.report_faults()
    bits = bench.loop.shared.words[Word.SUPERVISOR_FAULTS]
    return [fault for place, fault in enumerate(SUPERVISOR_FAULTS) if bits >> place & 1]


@pytest.mark.fault("D8")
@pytest.mark.parametrize("damaged", [1, 2])
def test_damaged_parameters_are_a_fault_at_the_start(bench: Bench, damaged: int) -> None:
    """D8 is reported until the loop has latched it, whether or not an older file can be used."""
    _learn(bench, zero_um=0.25)
    for _ in range(2):
        bench.do(lambda link: link.save_params(PEER))
    for path in sorted(bench.paths.parameters.glob("*.json"))[-damaged:]:
        path.write_bytes(path.read_bytes()[:-9])

    bench.do(lambda link: link.restore_params())
    before = _reported(bench)
    bench.record(State.SAFE, latched=mask([Fault.D8]))

    assert (before, _reported(bench)) == ([Fault.D8], [])
    assert len(bench.requests) == 2 - damaged


@pytest.mark.fault("D8")
def test_parameters_that_the_loop_refuses_at_the_start_are_a_fault(bench: Bench) -> None:
    """The stage does not adapt from another model than the saved one without a word."""
    _learn(bench, zero_um=0.25)
    bench.do(lambda link: link.save_params(PEER))

    lost = bench.do(lambda link: link.restore_params(), Answer(False, "its gain is not safe"))

    assert lost == ["the saved parameters: axis x: its gain is not safe"]
    assert _reported(bench) == [Fault.D8]


def test_no_parameters_at_the_start_are_no_fault(bench: Bench) -> None:
    """A stage whose parameters were never saved begins with the models of its configuration."""
    assert bench.do(lambda link: link.restore_params()) == []
    assert _reported(bench) == []
    assert bench.requests == []


class Exchange:
    """A bench whose loop is exchanged for another one.

    Args:
        bench: The bench.
        model_changed: Whether the file has another model for the new loop.
        answer: Answer of the new loop to every request; None to accept.
    """

    def __init__(
        self, bench: Bench, *, model_changed: bool = False, answer: Answer | None = None
    ) -> None:
        old = bench.loop
        asyncio.run(bench.link.parameters.keep(old, old.axes))
        bench.loop = bench.link.loop = bench.connection()
        if model_changed:
            model = old.file_models["x"]
            assert model is not None
            bench.loop.models["x"] = model.model_copy(update={"created_by": "another fit"})
        assert bench.loop.models["x"] is not None
        self.file_model = bench.loop.models["x"]
        self.lost = bench.do(lambda link: link.restore_params(), answer)
        self.requests = bench.requests


def test_parameters_outlive_an_exchange(bench: Bench) -> None:
    """The new loop begins with the zero and the weights in use, not with the saved ones."""
    _learn(bench, zero_um=0.0)
    bench.do(lambda link: link.save_params(PEER))
    weights = _learn(bench, zero_um=0.25)
    exchange = Exchange(bench)

    (request,) = exchange.requests
    assert isinstance(request, AdoptModel)
    model = request.model
    assert [*model.left_stop_weights, *model.right_stop_weights] == pytest.approx(weights)
    assert (request.zero_um, exchange.lost) == (0.25, [])


def test_model_that_was_exchanged_in_the_file_replaces_the_learned_one(bench: Bench) -> None:
    """The sensor zero stays, because it is not part of the model."""
    _learn(bench, zero_um=0.25)
    exchange = Exchange(bench, model_changed=True)

    assert exchange.requests == [AdoptModel(axis="x", model=exchange.file_model, zero_um=0.25)]


def test_zero_of_an_axis_without_a_model_is_reported_lost(bench: Bench) -> None:
    """The answer to the reload says what has to be done again."""
    bench.loop.models["x"] = bench.loop.file_models["x"] = None
    LearnedWriter(bench.loop.shared).publish(0, np.ones(4), 0.0, 0.0, 0.25)
    asyncio.run(bench.link.parameters.keep(bench.loop, {"x"}))

    lost = bench.do(lambda link: link.restore_params())

    assert lost == ["axis x: the sensor zero, because it has no model; `piezod zero` again"]


@pytest.mark.fault("D8")
def test_parameters_that_the_new_loop_refuses_are_reported_lost(bench: Bench) -> None:
    """They are named in the answer, and the stage has a fault that forbids adaptation."""
    _learn(bench, zero_um=0.25)
    exchange = Exchange(bench, answer=Answer(False, "its gain is not safe"))

    remedy = "`piezod params load` loads the saved ones"
    assert exchange.lost == [f"axis x: its gain is not safe; {remedy}"]
    assert _reported(bench) == [Fault.D8]


def test_parameters_of_other_axes_are_refused(tmp_path: Path, config: DaemonConfig) -> None:
    """A rebuilt stage may have other axes under the same name."""
    before = Bench(tmp_path, config.model_copy(update={"axes": {"y": config.axes["x"]}}))
    weights = np.ones(4)
    before.loop.models["y"] = None
    LearnedWriter(before.loop.shared).publish(0, weights, 0.0, 0.0, 0.0)
    before.do(lambda link: link.save_params(PEER))
    before.link.stage_audit.close()
    bench = Bench(tmp_path, config)

    with pytest.raises(NotNowError, match="axes that this stage does not have: y"):
        bench.do(lambda link: link.load_params(None, PEER))
    bench.link.stage_audit.close()


def test_number_that_was_never_saved_is_no_damaged_file(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    """The client gets the number; nothing is logged, because no file is damaged."""
    _learn(bench, zero_um=0.0)
    bench.do(lambda link: link.save_params(PEER))

    with pytest.raises(UnknownNameError, match="nothing is saved as 999") as raised:
        bench.do(lambda link: link.load_params(999, PEER))

    assert raised.value.details == {}
    assert "rejected" not in capsys.readouterr().err


def test_missing_parameters_are_an_error(bench: Bench) -> None:
    """Nothing can be loaded before the first save, nor saved before the first cycle."""
    with pytest.raises(UnknownNameError, match="nothing is saved"):
        bench.do(lambda link: link.load_params(None, PEER))
    with pytest.raises(NotNowError, match="nothing has been learned"):
        bench.do(lambda link: link.save_params(PEER))


def test_adopted_model_is_the_one_to_save(bench: Bench) -> None:
    """Weights learned later belong to the thresholds of the adopted model."""
    model = bench.loop.models["x"]
    assert model is not None
    other = model.model_copy(update={"created_by": "somebody else"})
    bench.do(lambda link: link.request(AdoptModel(model=other), PEER))

    assert bench.loop.models["x"] == other


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

    entries = asyncio.run(bench.link.audit_log(10))

    assert [(entry["what"], entry["why"]) for entry in entries] == [("goto", "cannot"), ("arm", "")]


def test_configuration_and_reload_are_passed_on(bench: Bench) -> None:
    """The configuration in force is returned as JSON."""
    assert bench.link.config()["rate_hz"] == 20
    assert asyncio.run(bench.link.reload(PEER)) == {"by": "somebody"}
    assert bench.link.realtime()["rate_hz"] == 20


def test_parameters_of_exchanged_devices_are_reported_lost(bench: Bench) -> None:
    """Zero and weights belong to the devices."""
    _learn(bench, zero_um=0.25)
    asyncio.run(bench.link.parameters.keep(bench.loop, set()))

    (lost,) = bench.do(lambda link: link.restore_params())

    assert lost.startswith("axis x: zero and weights, because its devices")
    assert bench.requests == []
