"""Both clients with a fake daemon."""

import asyncio
import gc
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import closing
from pathlib import Path

import pytest

from piezod.client import AsyncStageClient, StageClient
from piezod.client.calls import Call
from piezod.errors import (
    ClientError,
    NotAllowedError,
    NotReachedError,
    NotRunningError,
    RefusedError,
)
from piezod.messages.endpoints import ENDPOINTS
from tests.client.fake_daemon import ACCEPTED, STATUS, Asked, FakeDaemon, Raw, interval


def test_status_is_typed(stage: StageClient, daemon: FakeDaemon) -> None:
    """Results have typed fields, and keep the document of the daemon."""
    daemon.answers["GET status"] = {**STATUS, "later": "unknown"}

    status = stage.status()

    assert (status.state, status.mode, status.skipped_cycles) == ("RUN", "adaptive", 3)
    assert status.faults[0].remedy == "look at it"
    assert status.axes["x"].error_um == pytest.approx(0.1)
    assert status.document == {**STATUS, "later": "unknown"}


def test_missing_number_is_none(stage: StageClient, daemon: FakeDaemon) -> None:
    """Without a valid sample position and error are None."""
    axis = {"position_um": None, "command_um": 1.0, "drive_v": 0.0}
    daemon.answers["GET status"] = {**STATUS, "axes": {"x": axis}}

    status = stage.status()

    assert status.axes["x"].position_um is None
    assert status.axes["x"].error_um is None


def test_command_carries_the_clients_name(stage: StageClient, daemon: FakeDaemon) -> None:
    """Each request has the name of the client."""
    answer = stage.goto(12.5)

    assert daemon.asked == [Asked("POST goto", {"position_um": 12.5}, "test")]
    assert (answer.motion, answer.document) == (7, ACCEPTED)


def test_name_is_empty_by_default(daemon: FakeDaemon) -> None:
    """The name is empty unless a client has one of its own."""
    with (
        StageClient(socket=daemon.socket_path) as one,
        StageClient(socket=one.socket, name="scanner") as other,
    ):
        one.arm()
        other.arm()

    assert [each.client for each in daemon.asked] == ["", "scanner"]


def test_unhealthy_is_an_answer(stage: StageClient, daemon: FakeDaemon) -> None:
    """HTTP status 503 of `health` is an answer, not an error."""
    daemon.answers["GET health"] = Raw(503, b'{"healthy": false, "cycle_age_s": 2.5}')

    assert stage.health().healthy is False


@pytest.mark.parametrize(
    ("status", "error"),
    [
        (400, RefusedError),
        (401, NotAllowedError),
        (403, NotAllowedError),
        (409, RefusedError),
        (422, RefusedError),
        (429, RefusedError),
        (500, ClientError),
        (503, RefusedError),
        (504, RefusedError),
    ],
)
def test_error_documents_become_errors(
    stage: StageClient, daemon: FakeDaemon, status: int, error: type[ClientError]
) -> None:
    """An error has the text, the remedy and the code of the daemon."""
    daemon.refuse("POST goto", status, "refused", "the stage is SAFE", "piezod arm")

    with pytest.raises(ClientError) as caught:
        stage.goto(1.0)

    assert type(caught.value) is error
    assert str(caught.value) == "the stage is SAFE; piezod arm"
    assert caught.value.code == "refused"


@pytest.mark.parametrize(
    "answer",
    [
        Raw(404, b"<html>", "text/html"),
        Raw(502, b'{"error": "text"}'),
        Raw(200, b"no JSON"),
        Raw(200, b"[1]"),
        {"state": "SAFE"},
        {**STATUS, "skipped_cycles": "many"},
    ],
)
def test_answer_of_unexpected_form(
    stage: StageClient, daemon: FakeDaemon, answer: Raw | dict[str, object]
) -> None:
    """An answer with an unexpected form suggests to compare the versions."""
    daemon.answers["GET status"] = answer

    with pytest.raises(ClientError, match="the same version"):
        stage.status()


@pytest.mark.parametrize("client", [StageClient, AsyncStageClient])
def test_no_daemon(tmp_path: Path, client: type[StageClient | AsyncStageClient]) -> None:
    """A socket on which nothing listens means that no daemon runs."""
    with pytest.raises(NotRunningError, match=r"api.sock: no daemon is running there; start it"):
        client(socket=tmp_path / "api.sock")


# httpcore leaves the socket to the garbage collector if it cannot connect.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_daemon_that_has_gone(tmp_path: Path) -> None:
    """A daemon that ends after the client was made leads to NotRunningError."""
    daemon = FakeDaemon(tmp_path / "gone.sock")
    with daemon.running():
        stage = StageClient(socket=daemon.socket_path)

    with stage, pytest.raises(NotRunningError, match=r"gone.sock: the daemon has ended"):
        stage.stop()
    gc.collect()  # here and not in a later test, whose failure its warning would be


def test_daemon_that_does_not_answer(stage: StageClient, daemon: FakeDaemon) -> None:
    """A daemon that does not answer leads to an error after the time-out."""
    daemon.answering.clear()

    with pytest.raises(ClientError, match="the daemon does not answer in time; try again"):
        stage.call(Call(ENDPOINTS["status"], answer_within_s=0.01))


def test_closed_client_sends_nothing(daemon: FakeDaemon) -> None:
    """A method of a closed client raises RuntimeError."""
    with StageClient(socket=daemon.socket_path) as stage:
        pass

    with pytest.raises(RuntimeError, match="this client is closed"):
        stage.arm()
    assert daemon.asked == []


def test_telemetry_is_typed(stage: StageClient, daemon: FakeDaemon) -> None:
    """Each interval has the range of every quantity."""
    daemon.telemetry = [interval(1.0), interval(None)]

    with closing(stage.telemetry(5, ["x"])) as intervals:
        first, second = next(intervals), next(intervals)

    assert daemon.asked[0].what == "GET telemetry?rate_hz=5&axes=x"
    assert (first.t_s, first.cycles, first.state) == (100.0, 50, "RUN")
    assert (first.axes["x"].position_um.max, first.axes["x"].mode) == (1.0, "adaptive")
    assert second.axes["x"].position_um.last is None


def test_telemetry_ends_with_the_daemon(stage: StageClient, daemon: FakeDaemon) -> None:
    """The end of telemetry is an error."""
    daemon.telemetry = [interval()]

    with pytest.raises(NotRunningError, match="the daemon has ended"):
        list(stage.telemetry())


@pytest.mark.parametrize("data", [b"data: no JSON\n\n", b"data: [1]\n\n", b"data: {}\n\n"])
def test_telemetry_of_unexpected_form(stage: StageClient, daemon: FakeDaemon, data: bytes) -> None:
    """An event with an unexpected form is an error."""
    daemon.answers["GET telemetry"] = Raw(200, data, "text/event-stream")

    with pytest.raises(ClientError, match="the same version"):
        next(stage.telemetry())


def test_refused_telemetry(stage: StageClient, daemon: FakeDaemon) -> None:
    """A refused stream of telemetry raises the error of the daemon."""
    daemon.refuse("GET telemetry", 404, "not_found", "no axis 'q'", "axes: x")

    with pytest.raises(RefusedError, match="no axis 'q'; axes: x"):
        next(stage.telemetry(axes=["q"]))


def test_goto_and_wait(stage: StageClient, daemon: FakeDaemon) -> None:
    """goto_and_wait returns when its own movement has arrived; an earlier one does not count."""
    daemon.telemetry = [
        interval(1.0, motion=6, on_target=True, state="READY"),
        interval(12.4),
        interval(12.51, on_target=True),
    ]

    there = stage.goto_and_wait(12.5)

    assert (there.axis, there.motion, there.position_um) == ("x", 7, 12.51)
    assert there.document == {"axis": "x", "motion": 7, "position_um": 12.51}


@pytest.mark.parametrize(
    ("last", "text", "code"),
    [
        (interval(motion=8), "axis x: another movement has replaced this one", "superseded"),
        (
            interval(state="HOLD"),
            "axis x: the stage went to HOLD before it reached the target",
            "state",
        ),
        (interval(state="RAMP", faults=["S5", "L2"]), "RAMP because of S5, L2 before", "state"),
        (
            interval(state="SAFE", faults=["D10", "P7", "P11", "P15"]),
            "the stage went to SAFE before",
            "state",
        ),
        (interval(None, state="BLIND", on_target=True), "the stage went to BLIND", "state"),
    ],
)
def test_goto_that_does_not_arrive(
    stage: StageClient, daemon: FakeDaemon, last: dict[str, object], text: str, code: str
) -> None:
    """The error has the reason why the movement ended."""
    daemon.telemetry = [interval(), last]

    with pytest.raises(NotReachedError) as caught:
        stage.goto_and_wait(12.5, axis="x")

    assert text in str(caught.value)
    assert caught.value.code == code


def test_waiting_without_a_sensor_is_refused(stage: StageClient, daemon: FakeDaemon) -> None:
    """Nothing would see the position; the stage does not move."""
    axis = {"position_um": None, "command_um": 1.0, "drive_v": 0.0, "has_sensor": False}
    daemon.answers["GET status"] = {**STATUS, "axes": {"x": axis}}

    with pytest.raises(RefusedError, match=r"axis x has no sensor to see .* move without waiting"):
        stage.goto_and_wait(12.5)
    assert [each.what for each in daemon.asked] == ["GET status"]


def test_goto_that_takes_too_long(stage: StageClient, daemon: FakeDaemon) -> None:
    """After the time-out the error has the remaining distance."""
    daemon.telemetry = [interval()]

    with pytest.raises(NotReachedError, match=r"not on target within 0 s, the error is \+0.100 µm"):
        stage.goto_and_wait(12.5, timeout_s=0.0)
    daemon.telemetry = [interval(None)]
    with pytest.raises(NotReachedError, match=r"not on target within 0 s; the stage continues"):
        stage.goto_and_wait(12.5, timeout_s=0.0)


def test_stream(stage: StageClient, daemon: FakeDaemon) -> None:
    """Each setpoint is one line of the body."""
    daemon.answers["POST stream"] = {"accepted": True, "setpoints": 2}

    ended = stage.stream([{"x": 1.0}, {"x": 2.5}])

    assert daemon.asked[0].body == [{"x": 1.0}, {"x": 2.5}]
    assert ended.setpoints == 2


def test_setpoint_that_is_not_finite_ends_a_stream(stage: StageClient) -> None:
    """A setpoint that is not finite raises RefusedError."""
    with pytest.raises(RefusedError, match=r"setpoints must be finite \(got {'x': nan}\)"):
        stage.stream([{"x": 1.0}, {"x": float("nan")}])


def test_recording_is_copied(stage: StageClient, daemon: FakeDaemon, tmp_path: Path) -> None:
    """A recording gets its name when it is complete."""
    daemon.answers["GET recordings/20261121T120000Z"] = Raw(200, b"\x89HDF" * 100_000)

    size_bytes = stage.fetch_recording("20261121T120000Z", tmp_path / "a.h5")

    assert size_bytes == 400_000
    assert (tmp_path / "a.h5").read_bytes() == b"\x89HDF" * 100_000
    assert [path.name for path in tmp_path.glob("*a.h5*")] == ["a.h5"]


def test_recording_that_is_not_there(
    stage: StageClient, daemon: FakeDaemon, tmp_path: Path
) -> None:
    """An existing file stays if the recording is unknown; a name cannot be a path."""
    (tmp_path / "a.h5").write_text("before")
    daemon.refuse("GET recordings/..%2Fother", 404, "not_found", "no recording of that name")

    with pytest.raises(RefusedError, match="no recording of that name"):
        stage.fetch_recording("../other", tmp_path / "a.h5")

    assert (tmp_path / "a.h5").read_text() == "before"


Use = Callable[[AsyncStageClient], AsyncIterator[object]]


def test_async_client_does_the_same(daemon: FakeDaemon, tmp_path: Path) -> None:
    """The async client has the same results."""
    daemon.answers["GET status"] = STATUS
    daemon.answers["POST stream"] = {"accepted": True, "setpoints": 1}
    daemon.answers["GET recordings/a"] = Raw(200, b"HDF")
    daemon.telemetry = [interval(), interval(12.49, on_target=True)]

    async def setpoints() -> AsyncIterator[dict[str, float]]:
        yield {"x": 1.0}

    async def use() -> None:
        async with AsyncStageClient(socket=daemon.socket_path, name="test") as stage:
            assert (await stage.status()).state == "RUN"
            assert (await stage.goto_and_wait(12.5)).position_um == 12.49
            assert (await stage.stream(setpoints())).setpoints == 1
            assert await stage.fetch_recording("a", tmp_path / "a.h5") == 3

    asyncio.run(use())

    assert [each.what for each in daemon.asked] == [
        "GET status",
        "GET status",
        "POST goto",
        "GET telemetry?rate_hz=20",
        "POST stream",
        "GET recordings/a",
    ]
    assert (tmp_path / "a.h5").read_bytes() == b"HDF"


def test_async_client_has_the_same_errors(daemon: FakeDaemon, tmp_path: Path) -> None:
    """The async client has the same errors."""
    daemon.refuse("GET telemetry", 403, "forbidden", "nobody may look")
    daemon.refuse("GET recordings/a", 404, "not_found", "no recording of that name")

    async def use() -> None:
        async with AsyncStageClient(socket=daemon.socket_path) as stage:
            with pytest.raises(NotAllowedError, match="nobody may look"):
                await anext(stage.telemetry())
            with pytest.raises(RefusedError, match="no recording"):
                await stage.fetch_recording("a", tmp_path / "a.h5")
            del daemon.answers["GET telemetry"]
            daemon.telemetry = [interval()]
            with pytest.raises(NotRunningError):
                async for _ in stage.telemetry():
                    pass
            with pytest.raises(NotReachedError, match="not on target within 0 s"):
                await stage.goto_and_wait(12.5, timeout_s=0.0)

    asyncio.run(use())


def test_import_is_quick() -> None:
    """Importing the client imports neither httpcore nor pydantic; making a client does."""
    slow = {"h5py", "httpcore", "numba", "numpy", "pydantic", "rich", "ssl", "typer", "yaml"}
    code = f"import sys; import piezod.client; print({slow} & set(sys.modules))"

    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)

    assert ended.stdout == b"set()\n"


USED = """
import sys
from pathlib import Path
from piezod.client import StageClient

with StageClient(socket=Path(sys.argv[1])) as stage:
    stage.status()
print({"click", "httpx", "pygments", "rich", "typer"} & set(sys.modules))
"""


def test_using_a_client_imports_little(daemon: FakeDaemon) -> None:
    """A client needs neither httpx, nor what that imports for a command line of its own."""
    daemon.answers["GET status"] = STATUS
    command = [sys.executable, "-c", USED, str(daemon.socket_path)]

    ended = subprocess.run(command, capture_output=True, check=True)

    assert ended.stdout == b"set()\n"
