"""Clients on other computers, over TLS."""

import asyncio
from contextlib import closing
from pathlib import Path

import pytest

from piezod.client import AsyncStageClient, StageClient
from piezod.errors import (
    AmbiguousStageError,
    ClientError,
    NotAllowedError,
    NotRunningError,
    RefusedError,
)
from piezod.messages import requests
from piezod.web.api import MOST
from piezod.web.stages import Stages
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually
from tests.web.remote import Remote, new_certificate


@pytest.fixture
def stage(remote: Remote, monkeypatch: pytest.MonkeyPatch) -> StageClient:
    """Return a client on another computer."""
    for name, value in remote.environ().items():
        monkeypatch.setenv(name, value)
    return StageClient(name="lab")


def test_client_uses_a_stage_of_another_computer(
    stage: StageClient, daemon: Served, tmp_path: Path
) -> None:
    """Status, commands, telemetry, setpoints, and files arrive as over the socket."""
    (daemon.stage.recordings_folder / "scan.h5").write_bytes(bytes(range(256)) * 1024)
    with stage:
        assert (stage.place.stage, stage.socket) == ("bench", None)
        assert stage.status().axes["x"].command_um == 1.5
        assert stage.goto(2.5, axis="x").motion == 7
        with closing(stage.telemetry(50.0, ["y"])) as intervals:
            assert [*next(intervals).axes] == ["y"]
        assert stage.stream({"x": float(each)} for each in range(5)).setpoints == 5
        assert stage.fetch_recording("scan", tmp_path / "copy.h5") == 256 * 1024
        assert stage.metrics().startswith("lease 1")
        assert not stage.health().document.get("error")
    assert (tmp_path / "copy.h5").read_bytes() == bytes(range(256)) * 1024
    assert daemon.stage.requests[0] == requests.Goto(position_um=2.5, axis="x")
    assert daemon.stage.setpoints[-1] == {"x": 4.0}
    assert {each.peer.client for each in daemon.stage.audited} == {"lab@127.0.0.1"}


def test_async_client_uses_a_stage_of_another_computer(
    stage: StageClient,  # noqa: ARG001 - sets the environment
    daemon: Served,
) -> None:
    """The client for asyncio does the same."""

    async def run() -> tuple[str, float]:
        async with AsyncStageClient() as client:
            await client.hold()
            interval = await anext(client.telemetry(50.0))
            return (await client.status()).state, interval.t_s

    state, t_s = asyncio.run(run())

    assert (state, daemon.stage.requests) == ("SAFE", [requests.Hold()])
    assert t_s > 0.0


def test_session_ends_with_its_connection(stage: StageClient, daemon: Served) -> None:
    """The stage stops when a program on another computer disconnects, in whatever way."""
    with stage, stage.session():
        assert daemon.app.state.service.lease.held
        assert daemon.stage.requests == []

    eventually(lambda: daemon.stage.requests == [requests.Stop()])
    eventually(lambda: not daemon.app.state.service.lease.held)


def test_refusal_keeps_its_text(stage: StageClient, daemon: Served) -> None:
    """A refusal of the daemon arrives with code, text and remedy."""
    daemon.stage.refusal = "cannot move in SAFE"

    with stage, pytest.raises(RefusedError, match=r"cannot move in SAFE; .*faults") as refused:
        stage.goto(1.0)
    assert refused.value.code == "refused"


def test_stream_that_is_refused_ends(stage: StageClient, daemon: Served) -> None:
    """A stream that the daemon refuses before its end gets the refusal."""
    daemon.stage.stream_refusal = "in HOLD"

    with stage, pytest.raises(RefusedError, match="in HOLD"):
        stage.stream({"x": 1.0} for _ in range(100_000))


@pytest.mark.parametrize("names", ["IP:127.0.0.1", "DNS:other.example"])
def test_wrong_certificate_is_refused(
    stage: StageClient,  # noqa: ARG001 - sets the environment
    daemon: Served,
    names: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Neither token nor request leave the computer, if the server has another certificate."""
    monkeypatch.setenv("PIEZOD_CA", str(new_certificate(tmp_path, names).file))

    with (
        StageClient() as client,
        pytest.raises(ClientError, match=r"not trusted: self.signed.*PIEZOD_CA") as error,
    ):
        client.estop()
    assert (error.value.code, daemon.called()) == ("certificate", 0)


def test_certificate_of_another_name_is_refused(
    stage: StageClient,  # noqa: ARG001 - sets the environment
    remote: Remote,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A pinned certificate holds for its own names only."""
    monkeypatch.setenv("PIEZOD_STAGE", f"https://127.0.0.2:{remote.web.port}")

    with StageClient() as client, pytest.raises(ClientError, match=r"mismatch.*'127.0.0.2'"):
        client.status()


def test_without_a_certificate_file_the_system_decides(
    stage: StageClient,  # noqa: ARG001 - sets the environment
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A self-signed certificate is refused unless it is named."""
    monkeypatch.delenv("PIEZOD_CA")

    with StageClient() as client, pytest.raises(ClientError, match=r"not trusted: self.signed"):
        client.status()


def test_server_that_has_gone(
    stage: StageClient,  # noqa: ARG001 - sets the environment
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An address at which nothing listens means that no daemon runs."""
    monkeypatch.setenv("PIEZOD_STAGE", "https://127.0.0.1:9")

    with StageClient() as client, pytest.raises(NotRunningError, match=r"127.0.0.1:9: no answer"):
        client.status()


def test_stage_is_chosen_by_name(
    stage: StageClient, remote: Remote, daemon: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An address without a name means the only stage; several need a name."""
    stages = remote.web.stages
    assert stages is not None
    with StageClient(remote.url) as only, stage:
        assert only.status().state == stage.status().state == "SAFE"

        monkeypatch.setattr(stages, "_find", lambda: dict.fromkeys("ab", daemon.socket))
        with pytest.raises(AmbiguousStageError, match="several stages are running: a, b; name one"):
            only.status()
        with pytest.raises(RefusedError, match="no stage 'bench' on this machine; stages: a, b"):
            stage.status()

        monkeypatch.setattr(stages, "_find", Stages("none", dict)._find)  # noqa: SLF001 - finds none
        with pytest.raises(NotRunningError, match="no daemon is running on this machine"):
            only.status()


def test_daemon_that_has_ended(
    stage: StageClient, remote: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stage whose daemon has just ended is reported as not running."""
    monkeypatch.setattr(remote.web.stages, "_find", lambda: {"bench": tmp_path / "gone.sock"})

    with stage, pytest.raises(NotRunningError, match=r"no daemon is running there"):
        stage.status()


def test_emergency_stop_passes_a_crowd(stage: StageClient, remote: Remote, daemon: Served) -> None:
    """Requests of other computers are limited in number, but never an emergency stop."""
    streams = [stage.telemetry(1.0) for _ in range(MOST)]
    for each in streams:
        next(each)

    with stage:
        with pytest.raises(RefusedError, match=f"{MOST} requests of other computers") as refused:
            stage.status()
        stage.estop()
        for each in streams:
            each.close()
        assert eventually(
            lambda: remote.request("GET", "/v1/status", remote.web.access.tokens.user).is_success
        )

    assert (refused.value.code, daemon.stage.requests) == ("too_many", [requests.Estop()])


def test_viewer_looks_and_stops_in_an_emergency(
    stage: StageClient,  # noqa: ARG001 - sets the environment
    remote: Remote,
    daemon: Served,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second token allows what a viewer may do, although the server's user may do more."""
    token_file = remote.environ(remote.web.access.tokens.viewer)["PIEZOD_TOKEN_FILE"]
    monkeypatch.setenv("PIEZOD_TOKEN_FILE", token_file)

    with StageClient() as viewer:
        status = viewer.status()
        assert (status.state, status.role) == ("SAFE", "viewer")
        for refused in (viewer.arm, viewer.hold, viewer.save_params, viewer.reload):
            with pytest.raises(NotAllowedError, match="for looking only"):
                refused()
        viewer.estop()

    assert daemon.stage.requests == [requests.Estop()]
