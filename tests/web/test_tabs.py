"""What tabs do together, and what they leave behind."""

import asyncio
import json
import re
import socket
import threading
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from piezod.client import StageClient
from piezod.client.mirror import AT_MOST_EACH_S
from piezod.control.stage.answer import Answer
from piezod.errors import NotAllowedError, RefusedError
from piezod.messages.answers import AXIS, STAGE
from piezod.messages.endpoints import Role
from piezod.messages.requests import TABLE
from piezod.telemetry.arrays import record_dtype
from piezod.web import connections, messages, protocol
from piezod.web import tab as tab_module
from piezod.web.tab import MOST_CALLS
from tests.daemon.daemons import NO_TLS
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually
from tests.web.browser import Tab, Web, close_code
from tests.web.conftest import new_daemon

NEVER_S = 1000.0
"""No call that hangs ends before its test, however slow the machine is."""


def streams(served: Served) -> int:
    """Return the number of connections that get telemetry now."""
    found = 0
    for each in tuple(served.server.server_state.connections):
        cycle = getattr(each, "cycle", None)  # None before its first request
        if cycle is not None and not cycle.response_complete:
            found += cycle.scope["path"] == "/v1/telemetry"
    return found


def know(tab: Tab) -> None:
    """Wait until the server has a status of the stage."""
    eventually(lambda: tab.ask(do="stages")["result"]["stages"][0]["status"])


def test_stages_are_listed(web: Web) -> None:
    """A tab gets the names of the stages, and its own name."""
    with web.tab() as tab:
        know(tab)
        result = tab.ask(do="stages")["result"]

    assert result["client"].startswith(f"web:{web.port}:tab")
    assert result["role"] == "engineer"
    assert [each["stage"] for each in result["stages"]] == ["bench"]
    assert result["stages"][0]["up"]
    assert result["stages"][0]["status"]["state"] == "SAFE"


def test_page_knows_how_fields_are_shown(web: Web) -> None:
    """It has the descriptions that all adapters have, so that it shows a new field as they do."""
    script = web.request("GET", "/static/shown.js", Cookie=web.cookie())

    found = dict(re.findall(r"^export const (\w+) = (.*);$", script.text, re.MULTILINE))
    for kind, fields in (("AXIS", AXIS), ("STAGE", STAGE)):
        assert json.loads(found[kind]) == {name: field.document for name, field in fields.items()}


def test_command_has_the_answer_of_the_daemon(web: Web, daemon: Served) -> None:
    """The answer is the document of the endpoint, a refusal the error document with all keys."""
    with web.tab() as tab:
        assert tab.call("/v1/goto", {"position_um": 3.0})["result"]["motion"] == 7
        assert tab.call("/v1/audit?limit=1", method="GET")["result"]["audit"]
        daemon.stage.healthy = False
        assert not tab.call("/v1/health", method="GET")["result"]["healthy"]
        with web.tab() as other:
            held = other.call("/v1/arm")["error"]

        assert held["code"] == "lease_held"
        assert held["holder"]["client"] == tab.ask(do="stages")["result"]["client"]
        daemon.stage.refusal = "in FAULT"
        assert tab.call("/v1/arm")["error"]["what"] == "in FAULT"
        assert tab.call("/v1/arm")["error"]["remedy"]
        daemon.roles.role = Role.VIEWER
        assert tab.call("/v1/arm")["error"]["code"] == "forbidden"


def test_unknown_stage_is_refused(web: Web) -> None:
    """The answer names the stages that run."""
    with web.tab() as tab:
        for do in ("watch", "estop"):
            error = tab.ask(do=do, stage="nothing")["error"]
            assert (error["code"], error["remedy"]) == ("not_found", "stages: bench")


def test_all_tabs_share_one_stream(web: Web, daemon: Served) -> None:
    """Three tabs get the same rows from one stream, which ends when no tab looks."""
    with ExitStack() as stack:
        tabs = [stack.enter_context(web.tab()) for _ in range(3)]
        for tab in tabs:
            assert tab.ask(do="watch", stage="bench")["ok"]
        rows = [tab.event("telemetry", stage="bench") for tab in tabs]
        assert all(row["axes"].keys() == {"x", "y"} for row in rows)
        assert streams(daemon) == 1

        assert tabs[0].ask(do="unwatch")["ok"]
        tabs[1].connection.close()
        assert tabs[2].event("telemetry")
        assert streams(daemon) == 1
        assert tabs[2].ask(do="unwatch")["ok"]
        eventually(lambda: streams(daemon) == 0)


def test_new_rate_does_not_interrupt_the_stream(web: Web, daemon: Served) -> None:
    """A tab that watches the same stage at another rate goes on with the same stream."""
    opened = Mock(wraps=daemon.stage.open_reader)
    daemon.stage.open_reader = opened  # type: ignore[method-assign]
    with web.tab() as tab:
        for rate_hz in (30, 5, 30):
            assert tab.ask(do="watch", stage="bench", rate_hz=rate_hz)["ok"]
            assert tab.event("telemetry")

    assert opened.call_count == 1


def test_restless_stage_is_not_asked_all_the_time(web: Web, daemon: Served) -> None:
    """A value that changes in each interval causes few requests of the status."""
    asked = Mock(wraps=daemon.stage.status)
    daemon.stage.status = asked  # type: ignore[method-assign]
    daemon.stage.reader.waiting = [moving(motion) for motion in range(60)]
    began_s = time.monotonic()
    with web.tab() as tab:
        tab.ask(do="watch", stage="bench")
        for _ in range(40):
            tab.event("telemetry")
        requests, lasted_s = asked.call_count, time.monotonic() - began_s

    # The rows have the times of the stage; requests are limited in the time of this machine.
    assert 2 <= requests <= lasted_s / AT_MOST_EACH_S + 1


def moving(motion: int) -> Any:
    """Return a record with the number of a movement."""
    records = np.zeros(1, record_dtype(2))
    records["t_ns"] = time.monotonic_ns() + int(motion / 30 * 1e9)
    records["axes"]["motion"] = motion
    return records


def test_change_of_the_status_is_an_event(web: Web, daemon: Served) -> None:
    """A new state is sent to all tabs without a request; measured values alone are not."""
    with web.tab() as tab, web.tab() as other:
        tab.ask(do="watch", stage="bench")
        daemon.stage.state = "READY"
        for each in (tab, other):
            while each.event("status")["status"]["state"] != "READY":
                pass


def test_closed_tab_releases_its_lease(web: Web, daemon: Served) -> None:
    """Another client gets the lease at once, and the stage goes on: nothing stops it."""
    with web.tab() as tab:
        tab.call("/v1/arm")
        with (
            StageClient(socket=daemon.socket, name="other") as other,
            pytest.raises(RefusedError, match="holds the lease"),
        ):
            other.goto(1.0)

    def released() -> bool:
        return not daemon.app.state.service.lease.held

    eventually(released)
    assert [request.kind for request in daemon.stage.requests] == ["arm"]


class HangingStage:
    """Answers an emergency stop at once, and other requests at the end of the test."""

    def __init__(self, served: Served) -> None:
        self._answer = served.stage.request
        self.waiting = 0
        self.ended = threading.Event()

    async def request(self, request: Any, peer: Any) -> Answer:
        if request.kind != "estop":
            self.waiting += 1
            await asyncio.to_thread(self.ended.wait)
        return await self._answer(request, peer)


def test_emergency_stop_with_six_busy_tabs(
    web: Web, daemon: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six tabs wait for all their calls and send messages without pause; a stop is answered."""
    hanging = HangingStage(daemon)
    monkeypatch.setattr(daemon.stage, "request", hanging.request)
    row = replace(TABLE["stop"], answer_within_s=NEVER_S)
    monkeypatch.setattr(messages, "row_of", lambda _call: row)
    monkeypatch.setattr(messages, "TIMEOUT_S", (NEVER_S,) * 4)
    call = {"do": "call", "stage": "bench", "method": "POST", "path": "/v1/stop"}
    with ExitStack() as stack:
        tabs = [stack.enter_context(web.tab()) for _ in range(6)]
        stack.callback(hanging.ended.set)
        for tab in tabs:
            tab.ask(do="watch", stage="bench")
            for _ in range(MOST_CALLS):
                tab.send(**call)
        eventually(lambda: hanging.waiting >= 6)
        for tab in tabs:
            assert tab.ask(**call)["error"]["code"] == "too_many"
            tab.connection.send("not a message" * 100)
            for _ in range(200):
                tab.send(do="stages")
        for tab in tabs:
            assert tab.ask(do="estop", stage="bench")["ok"]
        assert [request.kind for request in daemon.stage.requests] == ["estop"] * 6


def test_emergency_stop_uses_an_open_connection(web: Web, daemon: Served) -> None:
    """The stop opens no connection: that of the status is already there."""
    with web.tab() as tab:
        know(tab)
        before = {id(each) for each in daemon.server.server_state.connections}
        assert tab.ask(do="estop", stage="bench")["ok"]
        assert {id(each) for each in daemon.server.server_state.connections} == before


def test_emergency_stop_on_a_connection_that_was_closed(web: Web, daemon: Served) -> None:
    """The daemon may have closed the idle connection; the stop goes over a new one."""
    with web.tab() as tab:
        know(tab)
        for each in tuple(daemon.server.server_state.connections):
            each.transport.get_extra_info("socket").shutdown(socket.SHUT_RDWR)
        assert tab.ask(do="estop", stage="bench")["ok"]


def test_tab_that_does_not_read_is_closed(
    web: Web, daemon: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tab that sends and never reads is closed, with what waits for it; others go on."""
    monkeypatch.setattr(protocol, "BLOCKED_S", 0.2)
    daemon.stage.configuration = {"text": "x" * 2_000_000}
    with web.tab() as tab, web.tab() as slow:
        tab.ask(do="watch", stage="bench")
        eventually(lambda: flooded(slow.connection))
        assert tab.ask(do="stages")["ok"]
        assert tab.event("telemetry")
        assert web.stages is not None
        eventually(lambda: web.stages and web.stages.tabs == 1)


def test_texts_that_wait_are_bounded(
    web: Web, daemon: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tab for which too much text waits is closed at once; others go on."""
    monkeypatch.setattr(tab_module, "MOST_WAITING", 100_000)
    with web.tab() as tab, web.tab() as other:
        assert tab.call("/v1/config", method="GET")["ok"]
        daemon.stage.configuration = {"text": "x" * 200_000}
        tab.connection.send(CONFIG)
        close_code(tab.connection)
        assert other.ask(do="stages")["ok"]


CONFIG = '{"id": 1, "do": "call", "stage": "bench", "method": "GET", "path": "/v1/config"}'


def flooded(connection: ClientConnection) -> bool:
    """Send messages without reading; return whether the connection has ended."""
    try:
        for _ in range(10):
            connection.send(CONFIG)
    except (ConnectionClosed, OSError):
        return True
    return False


def test_socket_that_is_closed_to_this_user(
    web: Web, daemon: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error names the group that opens the socket: the daemon itself has not ended."""
    refusal = NotAllowedError("not for this user", "become a member of the group piezod-view")
    monkeypatch.setattr(connections, "check_socket", Mock(side_effect=refusal))
    with web.tab() as tab:
        know(tab)
        other = daemon.socket.with_name("moved.sock")
        daemon.socket.rename(other)
        try:
            for each in tuple(daemon.server.server_state.connections):
                each.transport.get_extra_info("socket").shutdown(socket.SHUT_RDWR)
            error = tab.call("/v1/status", method="GET")["error"]
        finally:
            other.rename(daemon.socket)

    assert (error["code"], error["remedy"]) == ("not_allowed", refusal.remedy)


def test_recording_is_downloaded(web: Web, daemon: Served) -> None:
    """A link in the page leads to the file of a recording, which arrives unchanged."""
    content = bytes(range(256)) * 4000
    (daemon.stage.recordings_folder / "scan.h5").write_bytes(content)
    cookie = web.cookie()

    file = web.request("GET", "/recordings/bench/scan", Cookie=cookie)
    missing = web.request("GET", "/recordings/bench/none", Cookie=cookie)
    nowhere = web.request("GET", "/recordings/other/scan", Cookie=cookie)

    assert file.content == content
    assert file.headers["content-disposition"] == 'attachment; filename="scan.h5"'
    assert file.headers["content-length"] == str(len(content))
    assert (missing.status_code, missing.json()["error"]["code"]) == (404, "not_found")
    assert (nowhere.status_code, nowhere.json()["error"]["remedy"]) == (404, "stages: bench")
    assert web.request("GET", "/recordings/bench/scan").status_code == 401


def test_abandoned_download_ends_at_the_daemon(web: Web, daemon: Served) -> None:
    """A browser that leaves in the middle of a file leaves no download behind."""
    file = daemon.stage.recordings_folder / "scan.h5"
    with file.open("wb") as opened:
        opened.truncate(2**30)
    url = f"http://{web.host}/recordings/bench/scan"
    with httpx.stream("GET", url, headers={"Cookie": web.cookie()}, verify=NO_TLS) as response:
        first = next(response.iter_raw())
        assert response.status_code == 200, first
        assert daemon.app.state.service.downloads

    eventually(lambda: not daemon.app.state.service.downloads)


def test_daemon_that_ends_and_starts_again(tmp_path: Path) -> None:
    """All tabs learn since when it is down, and from when to when data are missing."""
    daemon = new_daemon(tmp_path)
    web = Web(lambda: {"bench": daemon.socket} if daemon.socket.exists() else {})
    with ExitStack() as stack:
        with daemon.running():
            stack.enter_context(web.running())
            tab, other = (stack.enter_context(web.tab()) for _ in range(2))
            tab.ask(do="watch", stage="bench")
            tab.event("telemetry")
        down = tab.event("stage", up=False)
        assert other.event("stage", up=False)["error"]["code"] == "not_running"
        assert tab.call("/v1/status", method="GET")["error"]["code"] == "not_running"
        assert not tab.ask(do="stages")["result"]["stages"][0]["up"]

        again = new_daemon(tmp_path)
        with again.running():
            up = tab.event("stage", up=True)
            assert tab.event("telemetry")
            assert other.event("stage", up=True)["missing"] == up["missing"]
            assert up["missing"]["from"] == down["since"] < up["missing"]["to"]
