import asyncio
import stat
import threading
from pathlib import Path

import httpx
import pytest

from piezod.daemon.service.app import bind, make_server
from piezod.daemon.service.connection import ConnectionLimits
from piezod.daemon.service.route import ROUTES
from piezod.messages.endpoints import Role
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually


def test_status_has_null_where_there_is_no_number(client: httpx.Client) -> None:
    """NaN becomes null in an answer."""
    status = client.get("status").json()

    assert (status["state"], status["lease"], status["role"]) == ("SAFE", None, "engineer")
    assert [status["axes"]["x"][key] for key in ("position_um", "drive_v")] == [None, 20.0]


def test_status_tells_the_role_of_the_client(client: httpx.Client, served: Served) -> None:
    """A program learns what it may do before it is refused."""
    served.roles.role = Role.VIEWER
    assert client.get("status").json()["role"] == "viewer"


def test_documents_of_the_stage_are_passed_on(client: httpx.Client) -> None:
    """Faults, real-time settings and configuration are the documents of the stage."""
    assert client.get("faults").json()["faults"][0]["id"] == "S5"
    assert client.get("realtime").json()["steps"] == []
    assert client.get("config").json() == {"rate_hz": 1000.0}


def test_answers_need_no_thread(client: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither answers nor errors are made in a worker thread, which costs time and memory."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a worker thread was requested")

    monkeypatch.setattr("anyio.to_thread.run_sync", refuse)
    requests = (("GET", "status"), ("POST", "stop"), ("POST", "goto"), ("GET", "unknown"))

    codes = [client.request(*each, json={} if each[0] == "POST" else None) for each in requests]

    assert [each.status_code for each in codes] == [200, 200, 422, 404]


def test_health_is_a_status_code(served: Served, client: httpx.Client) -> None:
    """The HTTP status shows the health without the document."""
    good = client.get("health")
    served.stage.healthy = False
    bad = client.get("health")

    assert (good.status_code, good.json()) == (200, {"healthy": True, "cycle_age_s": 0.01})
    assert (bad.status_code, bad.json()["healthy"]) == (503, False)


def test_audit_is_newest_first(client: httpx.Client) -> None:
    """The audit has at most `limit` entries."""
    for path in ("arm", "hold", "stop"):
        client.post(path)

    newest = client.get("audit?limit=2").json()["audit"]

    assert [each["what"] for each in newest] == ["stop", "hold"]


def test_description_has_every_endpoint(client: httpx.Client) -> None:
    """OpenAPI lists all endpoints, with the models of the bodies."""
    document = client.get("openapi").json()
    found = {
        (method.upper(), path) for path, methods in document["paths"].items() for method in methods
    }
    body = document["paths"]["/v1/goto"]["post"]["requestBody"]["content"]["application/json"]

    assert found == ROUTES.keys()
    assert body["schema"] == {"$ref": "#/components/schemas/Goto"}


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [("GET", "nothing", 404, "not_found"), ("PUT", "goto", 405, "method_not_allowed")],
)
def test_unknown_endpoint_is_an_error_document(
    client: httpx.Client, method: str, path: str, status: int, code: str
) -> None:
    """Unknown paths and methods are answered with code, text and remedy."""
    answer = client.request(method, path)

    assert answer.status_code == status
    assert answer.json()["error"].keys() == {"code", "what", "remedy"}
    assert answer.json()["error"]["code"] == code


def test_internal_error_is_an_error_document(
    served: Served, client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The text of an internal error is in the log only; the service continues."""

    def broken() -> None:
        raise ZeroDivisionError("secret")

    monkeypatch.setattr(served.stage, "status", broken)
    answer = client.get("status")

    assert answer.status_code == 500
    assert answer.json()["error"]["what"] == "internal error of the daemon: ZeroDivisionError"
    assert client.get("faults").status_code == 200


@pytest.mark.parametrize(
    ("accept", "kind", "openmetrics"),
    [
        ("*/*", "application/openmetrics-text", 1),
        ("application/openmetrics-text;q=0.6,text/plain;q=0.3", "application/openmetrics-text", 1),
        ("text/plain;version=0.0.4", "text/plain", 0),
    ],
)
def test_metrics_are_in_the_format_that_the_client_accepts(
    client: httpx.Client, accept: str, kind: str, openmetrics: int
) -> None:
    """Metrics are OpenMetrics, unless the client accepts only plain text."""
    answer = client.get("metrics", headers={"accept": accept})
    client.post("arm")  # takes the lease
    armed = client.get("metrics", headers={"accept": accept})

    assert answer.headers["content-type"].startswith(kind)
    assert answer.text == f"lease 0\nopenmetrics {openmetrics}\n"
    assert armed.text.startswith("lease 1")


@pytest.mark.fault("C6")
def test_socket_is_not_for_others(tmp_path: Path) -> None:
    """Only user and group can connect to the socket; an old socket is replaced."""
    path = tmp_path / "api.sock"
    path.touch()
    with bind(path):
        mode = path.stat().st_mode

    assert stat.S_ISSOCK(mode)
    assert stat.S_IMODE(mode) == 0o660


def test_socket_that_cannot_be_bound_is_an_error(tmp_path: Path) -> None:
    """A missing folder is an error, and no socket stays open."""
    with pytest.raises(FileNotFoundError):
        bind(tmp_path / "missing" / "api.sock")


def test_connection_without_a_user_is_refused(tmp_path: Path) -> None:
    """On a network socket no web page and no token is admitted."""
    served = Served(tmp_path, ConnectionLimits())
    server = make_server(served.app, ConnectionLimits())
    server.config.port = 0
    thread = threading.Thread(target=lambda: asyncio.run(server.serve()))
    thread.start()
    try:
        eventually(lambda: server.started)
        port = server.servers[0].sockets[0].getsockname()[1]
        headers = {"host": "piezod", "authorization": "Bearer 0", "origin": "http://piezod"}
        url = f"http://127.0.0.1:{port}/v1/stop"
        answer = httpx.post(url, headers=headers, trust_env=False)
    finally:
        server.should_exit = True
        thread.join()

    assert (answer.status_code, answer.json()["error"]["code"]) == (401, "unknown_peer")
    assert served.called() == 0
