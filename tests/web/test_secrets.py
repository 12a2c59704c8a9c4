"""Tokens, keys and certificates: who may use the server from elsewhere, and what stays secret."""

import asyncio
import json
import os
import re
import socket
import ssl
import subprocess
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import typer
from websockets.asyncio.client import connect
from websockets.typing import Origin

from piezod.cli.daemon.web import web as web_command
from piezod.client.place import Place, find_place
from piezod.config.private_files import kept_token, read_token
from piezod.errors import ClientError, DataError, PiezodError
from piezod.messages.endpoints import Role
from piezod.web import protocol
from piezod.web.access import Secrets, kept_tokens
from piezod.web.encryption import Certificate, check_certificate
from piezod.web.server import WebPlan, bind, serve
from tests.daemon.service.fakes import Served
from tests.daemon.service.raw import read_to_end
from tests.web.browser import Document
from tests.web.remote import Remote, new_certificate

TOKEN = "t" * 43


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1"])  # noqa: S104 - refused
def test_other_computers_need_encryption(host: str) -> None:
    """Without a certificate the server listens on this machine only, and says what to do."""
    with pytest.raises(PiezodError, match=r"without encryption: .*--certificate FILE --key FILE"):
        serve(WebPlan(host, 0), announce=print, warn=print)


def test_certificate_and_key_need_each_other() -> None:
    """One of the two options is a mistake."""
    with pytest.raises(typer.BadParameter, match="need each other"):
        web_command(certificate=Path("labpc.crt"))


def test_key_that_others_can_read_is_refused(tmp_path: Path) -> None:
    """The key of the certificate is for the user of the server and his group."""
    made = new_certificate(tmp_path)
    made.key.chmod(0o640)
    check_certificate(made)

    made.key.chmod(0o604)
    with pytest.raises(PiezodError, match=r"labpc.key: other users .*mode 0604.*: chmod 600"):
        serve(WebPlan("127.0.0.1", 0, made), announce=print, warn=print)


def test_key_with_a_passphrase_is_refused(tmp_path: Path) -> None:
    """A server cannot ask for a passphrase, and says how to make a key without."""
    made = new_certificate(tmp_path)
    locked = tmp_path / "locked.key"
    subprocess.run(
        ["openssl", "pkey", "-in", made.key, "-aes128", "-passout", "pass:abcd", "-out", locked],  # noqa: S607
        check=True,
    )

    with pytest.raises(PiezodError, match="passphrase; make a key without: openssl pkey"):
        check_certificate(Certificate(made.file, locked))


def test_key_of_another_certificate_is_refused(tmp_path: Path) -> None:
    """A key that does not fit, and a file that is none, are refused in words."""
    (tmp_path / "other").mkdir()
    made, other = new_certificate(tmp_path), new_certificate(tmp_path / "other")

    for wrong in (Certificate(made.file, other.key), Certificate(made.key, made.key)):
        with pytest.raises(PiezodError, match="are no certificate and its key in PEM form"):
            check_certificate(wrong)
    with pytest.raises(FileNotFoundError):
        check_certificate(Certificate(tmp_path / "none", made.key))


@pytest.mark.parametrize("which", ["file", "key"])
@pytest.mark.parametrize("kind", ["device", "pipe", "folder", "large"])
def test_certificate_that_is_no_small_file_is_refused(
    tmp_path: Path, kind: str, which: str
) -> None:
    """A device never ends, and a pipe waits for a writer."""
    made, odd = new_certificate(tmp_path), tmp_path / "odd"
    if kind == "pipe":
        os.mkfifo(odd, 0o600)
    elif kind == "folder":
        odd.mkdir(0o700)
    elif kind == "large":
        odd.touch(0o600)
        os.truncate(odd, 10**9)
    path = Path("/dev/zero") if kind == "device" else odd

    with pytest.raises(DataError, match="allowed"):
        check_certificate(made._replace(**{which: path}))


@pytest.mark.parametrize(("days", "outcome"), [(-1, "refused"), (10, "warned"), (100, "served")])
def test_validity_of_a_certificate_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, days: int, outcome: str
) -> None:
    """An expired one is refused, as every client would; one that expires soon is a warning."""
    made = new_certificate(tmp_path)
    end_s = ssl.cert_time_to_seconds(ssl._ssl._test_decode_cert(made.file)["notAfter"])  # type: ignore[attr-defined]  # noqa: SLF001 - there is no public one
    monkeypatch.setattr("piezod.web.encryption.time.time", lambda: end_s - 86_400 * days)

    try:
        found = "warned" if check_certificate(made) else "served"
    except PiezodError:
        found = "refused"

    assert found == outcome


@pytest.mark.fault("C12")
@pytest.mark.parametrize("given", ["", "Bearer", "Bearer wrong", f"Bearer {TOKEN}", "Basic abc"])
def test_without_the_token_nothing_is_forwarded(remote: Remote, daemon: Served, given: str) -> None:
    """A request without a token, or with a wrong one, is refused with a document."""
    header = {"Authorization": given} if given else {}
    for method, path in (("POST", "/v1/arm"), ("GET", "/stages/bench/v1/status"), ("GET", "/v1/")):
        answer = remote.request(method, path, **header)
        assert (answer.status_code, answer.json()["error"]["code"]) == (401, "unauthorised")
        assert answer.headers["www-authenticate"] == "Bearer"

    assert daemon.called() == 0


@pytest.mark.fault("C11")
def test_cookie_and_query_do_not_move_a_stage(remote: Remote, daemon: Served) -> None:
    """A page of another server can make a browser send cookies, but not the header."""
    token = remote.web.access.tokens.user
    cookie = remote.request("GET", f"/?token={token}").headers["set-cookie"]

    assert "; Secure" in cookie
    for path, header in (("/v1/arm", cookie.partition(";")[0]), (f"/v1/arm?token={token}", "")):
        assert remote.request("POST", path, Cookie=header).status_code == 401
    foreign = remote.request("POST", "/v1/arm", token, Origin="https://evil.example")
    assert (foreign.status_code, daemon.called()) == (403, 0)


@pytest.mark.fault("C11")
def test_page_without_encryption_is_a_foreign_page(remote: Remote) -> None:
    """A page that was forged on its way over plain HTTP may not use the server."""
    cookie = remote.request("GET", f"/?token={remote.web.access.tokens.user}")
    value = cookie.headers["set-cookie"].partition(";")[0]

    own, forged = (f"{scheme}://{urlsplit(remote.url).netloc}" for scheme in ("https", "http"))
    assert remote.request("GET", "/", Cookie=value, Origin=own).status_code == 200
    assert remote.request("GET", "/", Cookie=value, Origin=forged).status_code == 403


def test_name_of_the_certificate_is_served(remote: Remote) -> None:
    """With TLS a domain name is allowed: no foreign site has a certificate for it."""
    answer = remote.request(
        "GET", "/v1/status", remote.web.access.tokens.user, Host="labpc.example.org"
    )

    assert answer.json()["state"] == "SAFE"


async def _answers(remote: Remote, cookie: str, messages: Sequence[Document]) -> list[Document]:
    """Return the answers to messages of a tab.

    One thread does all: Python 3.11 does not let two threads share a TLS socket.
    """
    answers = list[Document]()
    async with connect(
        f"wss://127.0.0.1:{remote.web.port}/ws",
        ssl=remote.trusted,
        origin=Origin(remote.url),
        additional_headers={"Cookie": cookie},
    ) as connection:
        for number, message in enumerate(messages, 1):
            await connection.send(json.dumps({"id": number, **message}))
            async with asyncio.timeout(20):
                while (answer := json.loads(await connection.recv())).get("id") != number:
                    pass
            answers.append(answer)
    return answers


def test_tab_of_a_viewer_moves_nothing(remote: Remote, daemon: Served, tmp_path: Path) -> None:
    """The page that was opened with the token of a viewer shows stages, and stops them."""
    answer = remote.request("GET", f"/?token={remote.web.access.tokens.viewer}")
    cookie = answer.headers["set-cookie"].partition(";")[0]
    learn = {"do": "learn", "command_um": {}, "axis": "x"}
    arm, status = (
        {"do": "call", "method": method, "path": path, "body": None}
        for method, path in (("POST", "/v1/arm"), ("GET", "/v1/status"))
    )
    of_a_stage = [
        {"stage": "bench", **each}
        for each in (arm, learn, {"do": "end_job"}, status, {"do": "estop"})
    ]

    answers = asyncio.run(_answers(remote, cookie, [*of_a_stage, {"do": "stages"}]))

    assert [each["error"]["code"] for each in answers[:3]] == ["forbidden"] * 3
    assert [each["ok"] for each in answers[3:]] == [True] * 3
    assert daemon.called() == 1
    assert not (tmp_path / "tables").exists()


def test_limit_of_a_request_ends_with_its_connection(
    remote: Remote, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A WebSocket over TLS that was closed is left alone by the limit of time of its request."""
    monkeypatch.setattr(protocol, "REQUEST_S", 0.1)
    answer = remote.request("GET", f"/?token={remote.web.access.tokens.viewer}")

    asyncio.run(_answers(remote, answer.headers["set-cookie"].partition(";")[0], []))
    with remote.connection() as later:
        assert read_to_end(later) == b""  # ends by a limit that began after that of the WebSocket

    assert not [each for each in caplog.records if each.name == "asyncio"]


@pytest.mark.parametrize("source", ["127.0.0.1", "127.0.0.3"])
def test_plain_text_is_not_answered(remote: Remote, daemon: Served, source: str) -> None:
    """HTTP without TLS gets no answer, with the right token too, from whatever address."""
    bearer = f"Authorization: Bearer {remote.web.access.tokens.user}"
    request = f"POST /v1/arm HTTP/1.1\r\nHost: x\r\n{bearer}\r\n\r\n"
    with closing(
        socket.create_connection(("127.0.0.2", remote.web.port), 20.0, (source, 0))
    ) as connection:
        connection.sendall(request.encode())
        answer = connection.recv(4096)

    assert b"HTTP" not in answer  # an alert of TLS, or nothing
    assert daemon.called() == 0


def test_lost_computer_is_noticed() -> None:
    """Connections are probed, so that a session without its computer ends within 10 s."""
    accepted: list[socket.socket] = []
    with bind("127.0.0.1", 0) as endpoint:
        with closing(socket.create_connection(endpoint.getsockname())):
            accepted.append(endpoint.accept()[0])
        with accepted[0] as connection:
            options = [
                connection.getsockopt(level, option)
                for level, option in (
                    (socket.SOL_SOCKET, socket.SO_KEEPALIVE),
                    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE),
                    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL),
                    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT),
                )
            ]

    assert options[0]
    assert options[1] + options[2] * options[3] <= 10


def test_tokens_last_until_they_are_removed(tmp_path: Path) -> None:
    """A folder keeps the tokens; a removed one is made anew, and the old one is worth nothing."""
    folder = tmp_path / "tokens"
    first = kept_tokens(folder)
    assert kept_tokens(folder) == first
    assert folder.stat().st_mode & 0o077 == 0
    assert {file.name: file.stat().st_mode & 0o777 for file in folder.iterdir()} == {
        "user": 0o600,
        "viewer": 0o600,
    }

    (folder / "user").unlink()
    second = kept_tokens(folder)
    assert (second.viewer, second.user == first.user) == (first.viewer, False)
    scope = {
        "type": "http",
        "headers": [(b"authorization", f"Bearer {first.user}".encode())],
        "query_string": f"token={first.user}".encode(),
    }
    renewed = Secrets("piezod-8080", (), second)
    assert (renewed.header_role(scope), renewed.query_role(scope)) == (None, None)


def test_recorded_cookie_ends_with_the_server(tmp_path: Path) -> None:
    """A cookie is of one start, also if the tokens last."""
    tokens = kept_tokens(tmp_path / "tokens")
    before, now = Secrets("piezod-8080", (), tokens), Secrets("piezod-8080", (), tokens)
    answer = before.with_cookie(Role.VIEWER, secure=True)
    recorded = answer.headers["set-cookie"].partition(";")[0].encode()
    scope = {"type": "http", "headers": [(b"cookie", recorded)]}

    assert (before.cookie_role(scope), now.cookie_role(scope)) == (Role.VIEWER, None)


@pytest.mark.parametrize(
    ("text", "mode", "problem"),
    [
        (TOKEN, 0o644, "other users .* chmod 600"),
        ("short", 0o600, "this is no token"),
        ("", 0o600, "this is no token"),
        ("a b" * 20, 0o600, "this is no token"),
        ("µ" * 40, 0o600, "this is no token"),
    ],
)
def test_bad_token_file_is_refused(tmp_path: Path, text: str, mode: int, problem: str) -> None:
    """Server and client refuse a token that others can read, or guess, and do not print it."""
    file = tmp_path / "user"
    file.write_text(text, encoding="utf-8")
    file.chmod(mode)
    environ = {"PIEZOD_TOKEN_FILE": str(file)}

    for read in (
        lambda: read_token(file),
        lambda: kept_token(file),
        lambda: find_place("https://labpc:8080", None, environ),
    ):
        with pytest.raises(PiezodError, match=problem) as error:
            read()
        assert not text or text not in str(error.value)


def test_secret_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A token that somebody else has put there is known to him."""
    file = tmp_path / "user"
    file.touch(0o600)
    file.write_text(TOKEN)
    if os.getuid() == 0:
        os.chown(file, 4711, -1)
    else:
        monkeypatch.setattr("os.getuid", lambda: 4711)

    with pytest.raises(PiezodError, match=r"another user \(number \d+\) has made"):
        kept_tokens(tmp_path)


@pytest.mark.parametrize(
    ("address", "environ", "problem"),
    [
        (
            "https://labpc:8080",
            {},
            "needs a token; name the file of the token in PIEZOD_TOKEN_FILE",
        ),
        ("https://labpc:8080", {"PIEZOD_TOKEN_FILE": "/no/such"}, "/no/such: No such file"),
        ("https://labpc:8080", {"PIEZOD_TOKEN": "secret"}, "PIEZOD_TOKEN: this is no token"),
        (f"https://labpc/?token={TOKEN}", {}, "a token, a user or a query is refused"),
        (f"https://a:{TOKEN}@labpc", {}, "a token, a user or a query is refused"),
        ("http://labpc:8080", {"PIEZOD_TOKEN": TOKEN}, "without TLS is refused; use https"),
        ("https://", {"PIEZOD_TOKEN": TOKEN}, "has no host; an address is like https://labpc"),
    ],
)
def test_unsafe_address_is_refused(address: str, environ: dict[str, str], problem: str) -> None:
    """A token is in no argument and on no open network, and its text in no message."""
    for given, more in ((address, {}), (None, {"PIEZOD_STAGE": address})):
        with pytest.raises(ClientError, match=re.escape(problem)) as error:
            find_place(given, None, {**environ, **more})
        assert TOKEN not in str(error.value)


def test_place_of_an_address() -> None:
    """An address takes its token and certificate from the environment."""
    environ = {"PIEZOD_TOKEN": TOKEN, "PIEZOD_CA": "/a/labpc.crt"}
    place = find_place("https://labpc:8080/stages/bench/", None, environ)
    local = find_place("http://localhost:8080", None, environ)

    assert place == Place(None, "https://labpc:8080/stages/bench", TOKEN, Path("/a/labpc.crt"))
    assert (place.stage, local.stage, str(local)) == ("bench", "localhost", "http://localhost:8080")
    assert TOKEN not in repr(place)
    with pytest.raises(ClientError, match=r"/a/labpc.crt: no certificate can be read"):
        place.trusted()
