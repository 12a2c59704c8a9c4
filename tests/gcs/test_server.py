"""Places, addresses and the identity of the server."""

import socket
from ipaddress import IPv4Address
from pathlib import Path

import pytest
import typer

import piezod
from piezod.cli.daemon.gcs import gcs
from piezod.errors import PiezodError
from piezod.gcs.server import MOST_CLIENTS, GcsPlan, identity_of, refusal, serve
from piezod.messages.answers import Status
from tests.client.fake_daemon import FakeDaemon


def status_of(stage: str) -> Status:
    """Return the status of a stage of this name."""
    empty = {"state": "SAFE", "mode": "adaptive", "faults": ()}
    return Status(**empty, skipped_cycles=0, axes={}, stage=stage)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("stage", "like", "model"),
    [
        ("bench", "", "piezod bench"),
        ("bench", "E-754", "piezod bench like E-754"),
        ("a,b", "", "piezod a b"),
        ("", "", "piezod"),
    ],
)
def test_identity_has_four_fields_and_names_piezod(stage: str, like: str, model: str) -> None:
    """Clients split the identity at its commas, and take the second field for the model."""
    fields = identity_of(status_of(stage), like).split(", ")

    assert fields == ["(c)2026 piezod", model, "0", piezod.__version__]


@pytest.mark.parametrize(
    ("address", "clients", "text"),
    [
        ("127.0.0.1", 0, ""),
        ("127.0.0.1", MOST_CLIENTS, "8 clients are connected"),
        ("10.0.0.5", 0, ""),
        ("10.0.0.6", 0, "10.0.0.6 is not allowed: name it with --allow"),
    ],
)
def test_who_may_connect(address: str, clients: int, text: str) -> None:
    """This computer and the named addresses may connect, up to a number of clients."""
    plan = GcsPlan(Path("api.sock"), "trimmed", 0, [IPv4Address("10.0.0.5")])

    why = refusal(plan, IPv4Address(address), clients)

    assert text in why
    assert bool(why) == bool(text)


def test_port_in_use(tmp_path: Path) -> None:
    """The server says which port is in use, and how to choose another one."""
    daemon = FakeDaemon(tmp_path / "api.sock")
    with daemon.running(), socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]

        with pytest.raises(PiezodError, match=f"127.0.0.1:{port}: .*choose another port"):
            serve(GcsPlan(daemon.socket_path, "trimmed", port), announce=print, report=print)


def test_wrong_options() -> None:
    """A network is no address, and a stage has either a name or a socket."""
    with pytest.raises(typer.BadParameter, match=r"10\.0\.0\.0/8"):
        gcs(allow=["10.0.0.0/8"])
    with pytest.raises(typer.BadParameter, match="exclude each other"):
        gcs(stage="bench", socket=Path("api.sock"))
