"""What pages of others and people without the token try."""

import re

import pytest
from websockets.exceptions import InvalidStatus
from websockets.frames import CloseCode

from piezod.errors import PiezodError
from piezod.messages.endpoints import Role
from piezod.web.access import Secrets
from piezod.web.messages import LONGEST
from piezod.web.server import bind
from tests.daemon.service.fakes import Served
from tests.web.browser import Tab, Web, close_code


def refused_socket(web: Web, **options: str | None) -> int:
    """Try to open a WebSocket; return the HTTP status of the refusal."""
    with pytest.raises(InvalidStatus) as refused:
        web.socket(**options)  # type: ignore[arg-type]
    return refused.value.response.status_code


def test_the_token_becomes_a_cookie(web: Web) -> None:
    """The address with the token leads to one without; the cookie is out of reach of scripts."""
    answer = web.request("GET", f"/?token={web.access.tokens.user}")

    assert (answer.status_code, answer.headers["location"]) == (303, "./")
    assert "httponly" in answer.headers["set-cookie"].lower()
    assert "samesite=strict" in answer.headers["set-cookie"].lower()
    assert web.access.tokens.user not in answer.headers["set-cookie"]
    assert web.request("GET", "/", Cookie=web.cookie()).status_code == 200


@pytest.mark.fault("C12")
@pytest.mark.parametrize("path", ["/", "/static/app.js", "/metrics", "/elsewhere"])
@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", "?token=%C3%A9"])
def test_without_the_token_nothing_is_served(web: Web, path: str, query: str) -> None:
    """A request without the token, or with a wrong one, is refused."""
    answer = web.request("GET", path + query)

    assert (answer.status_code, "`piezod web` has printed" in answer.text) == (401, True)
    assert "set-cookie" not in answer.headers


@pytest.mark.fault("C12")
@pytest.mark.parametrize("value", ["", "wrong", "é"])
def test_foreign_cookie_is_refused(web: Web, value: str) -> None:
    """A cookie of another server, or of an earlier start on the same port, is refused."""
    answer = Secrets(f"piezod-{web.port}").with_cookie(Role.ENGINEER, secure=False)
    earlier = answer.headers["set-cookie"].partition(";")[0]
    name = earlier.partition("=")[0]

    assert name == web.cookie().partition("=")[0]
    assert web.request("GET", "/", Cookie=earlier).status_code == 401
    assert refused_socket(web, cookie=earlier) == 403
    assert refused_socket(web, cookie=f"{name}={value}".encode().decode("latin-1")) == 403


@pytest.mark.fault("C11")
@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", None])
def test_socket_of_another_page_is_refused(web: Web, origin: str | None) -> None:
    """A WebSocket needs the origin of this page, even with the cookie: ports share cookies."""
    assert refused_socket(web, cookie=web.cookie(), origin=origin) == 403


@pytest.mark.fault("C11")
@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_request_of_another_page_is_refused(web: Web, method: str) -> None:
    """A request with a foreign origin is refused, with the cookie too."""
    answer = web.request(method, "/", Cookie=web.cookie(), Origin="http://evil.example")

    assert (answer.status_code, "http://evil.example" in answer.text) == (403, True)


def test_only_the_socket_changes_anything(web: Web) -> None:
    """HTTP has GET and HEAD, with the own origin too."""
    answer = web.request("POST", "/", Cookie=web.cookie(), Origin=f"http://{web.host}")

    assert (answer.status_code, answer.headers["allow"]) == (405, "GET, HEAD")


@pytest.mark.fault("C11")
@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "localhost.evil.example"])
def test_foreign_name_is_refused(web: Web, host: str) -> None:
    """A domain name that was made to lead to this machine is refused, with cookie and origin."""
    cookie = web.cookie()

    assert web.request("GET", f"/?token={web.access.tokens.user}", Host=host).status_code == 403
    assert web.request("GET", "/", Cookie=cookie, Host=host).status_code == 403
    assert refused_socket(web, cookie=cookie, host=host, origin=f"http://{host}") == 403


@pytest.mark.parametrize("host", ["localhost:8080", "[::1]:9000", "127.0.0.1", "labpc"])
def test_forwarded_port_is_served(web: Web, host: str) -> None:
    """A browser that reaches the server by a forwarded port has another `Host`."""
    cookie = web.cookie()

    assert web.request("GET", "/", Cookie=cookie, Host=host).status_code == 200
    with web.socket(cookie=cookie, host=host, origin=f"http://{host}") as connection:
        assert Tab(connection).ask(do="stages")["ok"]


def test_metrics_take_the_token(web: Web) -> None:
    """The metrics of all stages are served to a program that has the token."""
    by_header = web.request("GET", "/metrics", Authorization=f"Bearer {web.access.tokens.user}")
    by_query = web.request("GET", f"/metrics?token={web.access.tokens.user}")

    assert by_header.text == by_query.text == "lease 0\nopenmetrics 0\n"
    assert by_header.headers["content-type"].startswith("text/plain; version=0.0.4")


def test_page_may_load_nothing_else(web: Web) -> None:
    """Every answer has the policy without inline code and foreign servers."""
    for answer in (web.request("GET", "/", Cookie=web.cookie()), web.request("GET", "/")):
        policy = answer.headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
        assert "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_page_has_no_inline_code(web: Web) -> None:
    """The policy would refuse inline code, inline style and files of other servers."""
    page = web.request("GET", "/", Cookie=web.cookie()).text

    assert not re.findall(r"<script(?![^>]*\bsrc=)|<style|\sstyle=|\son[a-z]+\s*=", page)
    assert not re.findall(r"""(?:src|href|action)=["']?(?:[a-z]+:)?//""", page)
    files = re.findall(r"""(?:src|href)=["']([^#"'][^"']*)""", page)
    assert [web.request("GET", f"/{file}", Cookie=web.cookie()).status_code for file in files] == [
        200
    ] * len(files)


def test_too_long_message_closes_the_socket(web: Web) -> None:
    """A message that is longer than any request ends the tab, and no other one."""
    with web.tab() as other:
        with web.tab() as tab:
            tab.connection.send("x" * (LONGEST + 1))
            assert close_code(tab.connection) == 1009
        assert other.ask(do="stages")["ok"]


@pytest.mark.parametrize("parts", [[b"\xff"], [b'{"id": 1, "do": "\xc3', b'stages"}']])
def test_text_that_is_not_utf8_closes_the_socket(
    web: Web, parts: list[bytes], caplog: pytest.LogCaptureFixture
) -> None:
    """The tab learns why, other tabs go on, and there is no traceback: anybody can send this."""
    with web.tab() as other:
        with web.tab() as tab:
            tab.connection.send(parts, text=True)
            assert close_code(tab.connection) == CloseCode.INVALID_DATA
            assert "UTF-8" in str(tab.connection.close_reason)
        assert other.ask(do="stages")["ok"]
    assert not caplog.records


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", "7", "\x00", "[" * 100_000),
        *('{"id": 1}', '{"id": -1, "do": "stages"}', '{"id": "1", "do": "stages"}'),
        *('{"id": 1, "do": "format"}', '{"id": 1, "do": "stages", "more": 1}'),
        '{"id": 1, "do": "watch", "stage": "bench", "rate_hz": 1000}',
    ],
)
def test_malformed_message_is_answered(web: Web, text: str) -> None:
    """A text that is no message is refused in words, and the tab goes on."""
    with web.tab() as tab:
        tab.connection.send(text)
        assert (error := tab.answer(None)["error"])["code"] == "invalid"
        assert error["what"]
        assert tab.ask(do="stages")["ok"]


def test_bytes_are_no_message(web: Web) -> None:
    """A binary message is refused, and the tab goes on."""
    with web.tab() as tab:
        tab.connection.send(b"\xff\xfe")
        assert tab.answer(None)["error"]["code"] == "invalid"
        assert tab.ask(do="stages")["ok"]


@pytest.mark.parametrize(
    ("method", "path"),
    [
        *(("GET", "/v1/telemetry"), ("POST", "/v1/stream"), ("POST", "/v1/session")),
        *(("GET", "/v1/recordings/a"), ("GET", "/etc/passwd"), ("GET", "/v1/../v1/status")),
        *(("POST", "/v1/status"), ("TRACE", "/v1/status"), ("POST", "//evil.example/v1/arm")),
        *(("GET", "/v1/status?a=b c"), ("GET", "/v1/status\r\nX: y"), ("POST", "/v1/arm#x")),
    ],
)
def test_other_paths_are_refused(web: Web, daemon: Served, method: str, path: str) -> None:
    """A page may send the requests of the table of commands only."""
    with web.tab() as tab:
        answer = tab.call(path, {}, method)

    assert answer["error"]["code"] == "not_found"
    assert daemon.called() == 0


def test_body_that_is_not_json_is_refused(web: Web, daemon: Served) -> None:
    """A number that JSON does not have goes no further."""
    with web.tab() as tab:
        tab.ask(do="stages")
        fields = '"do": "call", "stage": "bench", "method": "POST", "path": "/v1/goto"'
        tab.connection.send(f'{{"id": 90, {fields}, "body": {{"position_um": NaN}}}}')
        assert tab.answer(90)["error"]["code"] == "bad_json"

    assert daemon.called() == 0


def test_used_port_is_refused_in_words(web: Web) -> None:
    """A second server on the port, or a host of another machine, is refused with the remedy."""
    with pytest.raises(PiezodError, match=f"127.0.0.1:{web.port}: .* another port with --port"):
        bind("127.0.0.1", web.port)
    with pytest.raises(PiezodError, match="check the name with --host"):
        bind("no.such.invalid", 0)
