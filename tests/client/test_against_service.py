"""The clients with the service of the daemon."""

import asyncio
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from piezod.client import AsyncStageClient, StageClient
from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.daemon.service.connection import ConnectionLimits
from piezod.errors import NotAllowedError, NotRunningError, RefusedError
from piezod.messages import requests
from piezod.messages.endpoints import Role
from piezod.telemetry.arrays import record_dtype
from tests.control.surface_rig import surface_file
from tests.daemon.service.fakes import Served

ROOT = Path(__file__).parents[2]
SINE = {"kind": "sine", "low": 0, "high": 10.0, "frequency_hz": 1.0}


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """Return a service whose stage accepts everything."""
    served = Served(tmp_path, ConnectionLimits())
    with served.running():
        yield served


@pytest.fixture
def stage(served: Served) -> Iterator[StageClient]:
    """Return a client of that service."""
    with StageClient(socket=served.socket, name="test") as stage:
        yield stage


def test_name_that_is_not_allowed_is_refused_in_words(served: Served) -> None:
    """A client whose name has other characters learns which are allowed."""
    with (
        StageClient(socket=served.socket, name="µm scan") as stage,
        pytest.raises(RefusedError, match=r"X-Piezod-Client: allowed: up to 64 letters"),
    ):
        stage.status()


def test_every_request_arrives_as_it_was_meant(served: Served, stage: StageClient) -> None:
    """Each method sends its request with all fields."""
    model = load_model(ROOT / "config" / "models" / "simulated-stack.yaml")

    stage.arm(shadow=True)
    stage.mode("adaptive", axis="x")
    answer = stage.goto(12, speed_um_per_s=5)
    stage.wave({"x": SINE, "y": {"kind": "points", "points": [[0, 1], [1, 2]]}}, 3)
    stage.follow(axis="x")
    stage.hold()
    stage.resume()
    stage.condition(axis="y")
    stage.zero()
    stage.identify({"x": SINE}, 2.5)
    stage.adopt(model, axis="x", zero_um=1.5)
    stage.stop()
    stage.estop()
    stage.reset(engineer=True)
    stage.disarm()
    stage.shutdown()

    assert answer.motion == 7
    assert served.stage.requests[:3] == [
        requests.Arm(shadow=True),
        requests.SelectMode(mode=Mode.ADAPTIVE, axis="x"),
        requests.Goto(position_um=12.0, speed_um_per_s=5.0),
    ]
    assert [request.kind for request in served.stage.requests[3:]] == [
        *("wave", "follow", "hold", "resume", "condition", "zero", "identify", "adopt"),
        *("stop", "estop", "reset", "disarm", "shutdown"),
    ]
    adopted = served.stage.requests[10]
    assert adopted == requests.AdoptModel(axis="x", model=model, zero_um=1.5)


def test_reports(served: Served, stage: StageClient) -> None:
    """The client reads every report of the service."""
    served.stage.healthy = False

    assert stage.status().axes["x"].position_um is None
    assert stage.faults().faults[0].id == "S5"
    assert stage.health().healthy is False
    assert stage.realtime().steps == ()
    assert stage.config() == {"rate_hz": 1000.0}
    assert stage.metrics() == "lease 0\nopenmetrics 0\n"
    assert stage.params().sequence == 3
    assert stage.params_history().history[0].sequence == 3
    assert stage.save_params().sequence == 4
    assert stage.load_params().sequence == 3
    assert stage.restore_params(2).sequence == 2
    assert stage.reload().changes == ("by somebody",)
    assert stage.audit().audit[0].what == "reload"


def test_recordings(served: Served, stage: StageClient, tmp_path: Path) -> None:
    """A recording is started, ended, listed and copied."""
    (served.stage.recordings_folder / "20261121T120000Z.h5").write_bytes(b"HDF")

    assert stage.start_recording("creep").name == "20261121T120000Z-creep"
    assert stage.stop_recording().records == 5
    assert [each.name for each in stage.recordings().recordings] == ["20261121T120000Z"]
    assert stage.keep_recording("20261121T120000Z").kept
    assert stage.fetch_recording("20261121T120000Z", tmp_path / "copy.h5") == 3


def test_telemetry(served: Served, stage: StageClient) -> None:
    """Records become ranges; an unknown value is None."""
    records = np.zeros(3, record_dtype(2))
    records["t_ns"] = [1_000_000_000, 1_500_000_000, 2_000_000_000]
    records["axes"]["position_um"][:, 0] = [1.0, 9.0, 2.0]
    records["axes"]["position_um"][:, 1] = np.nan
    served.stage.reader.waiting = [records]

    with closing(stage.telemetry(50, ["x", "y"])) as intervals:
        interval = next(intervals)

    assert (interval.t_s, interval.cycles, interval.state) == (2.0, 3, "BOOT")
    assert (interval.axes["x"].position_um.max, interval.axes["x"].position_um.last) == (9.0, 2.0)
    assert interval.axes["y"].position_um.max is None


def test_stream(served: Served, stage: StageClient) -> None:
    """Each setpoint arrives; the first one names the axes."""
    ended = stage.stream({"x": float(number)} for number in range(5))

    assert ended.setpoints == 5
    assert served.stage.requests == [requests.Stream(axes=("x",))]
    assert served.stage.setpoints == [{"x": float(number)} for number in range(5)]


def test_refused_stream_ends_while_setpoints_come(served: Served, stage: StageClient) -> None:
    """The client reads the refusal while it is still sending."""
    served.stage.refusal = "the stage is SAFE"

    def endless() -> Iterator[dict[str, float]]:
        while True:
            yield {"x": 1.0}

    with pytest.raises(RefusedError, match="the stage is SAFE"):
        stage.stream(endless())


def test_refusals(served: Served, stage: StageClient) -> None:
    """Refusals for state, lease, role and unknown names are errors with a code."""
    with (
        StageClient(socket=served.socket, name="other") as other,
        pytest.raises(RefusedError, match=r"somebody \(test\) holds the lease") as held,
    ):
        stage.renew_lease()
        other.goto(1.0)
    assert held.value.code == "lease_held"
    assert stage.release_lease().released

    served.stage.refusal = "the stage is SAFE"
    with pytest.raises(RefusedError, match="the stage is SAFE; `piezod status` shows"):
        stage.goto(1.0)
    with pytest.raises(RefusedError, match="no parameters of number 99"):
        stage.restore_params(99)
    with pytest.raises(RefusedError, match="no axis 'q'"):
        next(stage.telemetry(axes=["q"]))
    served.roles.role = Role.VIEWER
    with pytest.raises(NotAllowedError, match="this needs operator"):
        stage.goto(1.0)


def test_async_client(served: Served) -> None:
    """The async client works with the service."""

    async def use() -> None:
        async with AsyncStageClient(socket=served.socket) as stage:
            assert (await stage.goto(1.0)).motion == 7
            assert (await stage.params()).sequence == 3

    asyncio.run(use())

    assert served.stage.requests == [requests.Goto(position_um=1.0)]


def test_service_that_ends(tmp_path: Path) -> None:
    """The end of the service ends telemetry with an error."""
    served = Served(tmp_path, ConnectionLimits())
    with served.running():
        served.stage.reader.waiting = [np.zeros(1, record_dtype(2))]
        stage = StageClient(socket=served.socket)
        intervals = stage.telemetry(50)
        next(intervals)

    with stage, pytest.raises(NotRunningError, match="the daemon has ended"):
        next(intervals)


def test_surface_arrives_to_the_bit(served: Served, stage: StageClient) -> None:
    """A model of version 2 is adopted over HTTP with every coefficient, and a negative delay."""
    model = surface_file().model_copy(update={"delay_s": -4.4e-4})

    stage.adopt(model, axis="x")

    assert served.stage.requests == [requests.AdoptModel(axis="x", model=model)]
