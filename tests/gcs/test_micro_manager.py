"""The requests of Micro-Manager, over TCP, move the simulated stage of a real daemon."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.daemon.daemons import Daemon, configuration
from tests.daemon.waiting import eventually
from tests.forked import forked
from tests.gcs.dialogues import MICRO_MANAGER, MOVING
from tests.gcs.gcs_client import GcsClient

TRIM: Final = "{base: feedforward, gain_per_s: 5, authority_pct: 5}"
OF_THE_STAGE: Final = ("*IDN?", "TPC?", MOVING, "POS? 1")
"""Requests with other replies than those of the stage with two axes that is always at 1.5 µm."""
TARGET_UM: Final = 5.0
"""Where the dialogue moves."""


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    """Return the daemon of a simulated stage, "rig", with one axis that a GCS client can trim."""
    with Daemon(configuration(tmp_path, trim=TRIM)) as daemon:
        yield daemon.up()


@pytest.fixture
def adapter(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> Iterator[GcsClient]:
    """Return a connection to `piezod gcs`."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(daemon.folder))
    with forked("gcs", "--port", "0") as process:
        match = re.match(r"GCS 2 at 127\.0\.0\.1:(\d+)", process.stdout.readline())
        assert match
        with GcsClient(int(match[1])) as client:
            yield client


def reply_to(adapter: GcsClient, request: str, expected: str | None) -> str:
    """Return the reply to a request as the adapter takes it: it asks until nothing moves."""
    if request == MOVING:
        eventually(lambda: adapter.ask(MOVING) == "0")
        return "0"
    if expected == "":
        adapter.send(f"{request}\n".encode())
        return ""
    return adapter.ask(request)


def position_um(adapter: GcsClient, query: str = "POS? 1") -> float:
    """Return a position that the stage reports."""
    return float(adapter.ask(query).removeprefix("1="))


def test_micro_manager_moves_and_stops_the_simulated_stage(
    adapter: GcsClient, daemon: Daemon
) -> None:
    """Position, limits, on-target, errors and stop are what the adapter expects."""
    replies = {}
    for request, expected in MICRO_MANAGER:
        own = request.replace("ONL 1 1 2 1", "ONL 1 1")  # it asks for the number of axes before
        reply = reply_to(adapter, own, expected)
        if request in OF_THE_STAGE:
            replies[request] = reply
        else:
            assert (request, reply) == (request, expected)
    assert adapter.ask("ERR?") == "10"

    assert replies["*IDN?"].startswith("(c)2026 piezod, piezod rig, 0, ")
    assert replies["TPC?"] == "1"
    assert float(replies["POS? 1"].removeprefix("1=")) == pytest.approx(TARGET_UM, abs=0.4)
    axis = eventually(lambda: on_target(daemon))
    assert axis["target_um"] == pytest.approx(TARGET_UM, abs=0.4)  # 99 µm was refused

    assert adapter.do("VEL 1 2") == 0
    assert adapter.do("MOV 1 20") == 0
    eventually(lambda: position_um(adapter) > TARGET_UM + 0.5)
    assert adapter.ask(MOVING) == "1"
    assert adapter.do("STP") == 10
    eventually(lambda: adapter.ask(MOVING) == "0")
    assert TARGET_UM < position_um(adapter, "MOV? 1") < 20.0
    assert position_um(adapter) == pytest.approx(position_um(adapter, "MOV? 1"), abs=0.4)
    assert adapter.ask("SVO? 1") == "1=1"
    assert daemon.status()["state"] == "RUN"


def on_target(daemon: Daemon) -> dict[str, float]:
    """Return the status of the axis as soon as the daemon reports it on target."""
    axis: dict[str, float] = daemon.status()["axes"]["x"]
    return axis if axis["on_target"] else {}
