"""The stage as the HTTP service sees it, with a loop without devices."""

import asyncio
from collections.abc import Iterator
from math import isnan, nan
from pathlib import Path

import numpy as np
import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.requests import AdoptModel, Arm, Goto, Shutdown
from piezod.config.states import State
from piezod.control.faults.table import FAULTS
from piezod.control.stage.answer import Answer
from piezod.daemon.loop import accept
from piezod.daemon.service.stage_service import (
    AuditEntry,
    BadValueError,
    NotNowError,
    UnavailableError,
    UnknownNameError,
)
from piezod.telemetry.learned import LearnedWriter
from piezod.telemetry.stream import StreamReader
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


def test_requests_during_an_exchange_are_refused(bench: Bench) -> None:
    """The client gets an error at once instead of waiting."""
    bench.link.available = False

    with pytest.raises(UnavailableError, match="being exchanged"):
        bench.do(lambda link: link.request(Goto(position_um=4.0), PEER))

    assert not bench.link.health()[0]


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
