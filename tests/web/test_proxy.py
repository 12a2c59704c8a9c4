"""The page and the API behind reverse proxies by others, in a folder, with a domain name."""

import re
import socket
import ssl
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import urljoin

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from piezod.client import StageClient
from piezod.errors import PiezodError
from piezod.messages import requests
from piezod.web.encryption import Certificate
from piezod.web.public_url import PublicUrl
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually
from tests.web import proxies
from tests.web.browser import Tab, Web
from tests.web.remote import new_certificate


class Proxy:
    """A browser, or a program, that knows the proxy only.

    Args:
        web: The server behind it.
        certificate: Certificate of the proxy.
        port: Its port.
    """

    def __init__(self, web: Web, certificate: Certificate, port: int) -> None:
        self.web, self.certificate, self.port = web, certificate, port
        self.origin = f"https://{proxies.NAME}:{port}"
        self.url = f"{self.origin}{proxies.PATH}"
        self._trusted = ssl.create_default_context(cafile=certificate.file)

    def get(self, url: str, **headers: str) -> httpx.Response:
        """Get an address; follow no redirection."""
        with httpx.Client(verify=self._trusted, timeout=20) as client:
            return client.get(url, headers=headers)

    def socket(self, cookie: str, origin: str | None = None) -> ClientConnection:
        """Return an open WebSocket."""
        return connect(
            f"{self.url.replace('https', 'wss')}ws",
            sock=socket.create_connection(("127.0.0.1", self.port), timeout=20),
            ssl=self._trusted,
            origin=Origin(origin or self.origin),
            additional_headers={"Cookie": cookie},
            max_size=None,
        )


@pytest.fixture(params=["nginx", "caddy"])
def proxy(
    request: pytest.FixtureRequest, daemon: Served, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[Proxy]:
    """Return a proxy in front of a server that knows its address."""
    certificate = new_certificate(tmp_path, f"DNS:{proxies.NAME},IP:127.0.0.1")
    port, real = proxies.free_port(), socket.getaddrinfo

    def found(name: str, *args: object, **options: object) -> object:
        return real("127.0.0.1" if name == proxies.NAME else name, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(socket, "getaddrinfo", found)
    web = Web(
        lambda: {"bench": daemon.socket},
        public=PublicUrl.of(f"https://{proxies.NAME}:{port}{proxies.PATH}"),
    )
    with (
        web.running(),
        proxies.running(request.param, tmp_path, certificate, port, web.port),
    ):
        yield Proxy(web, certificate, port)


def test_page_works_behind_a_proxy(proxy: Proxy) -> None:
    """Address, cookie, files and WebSocket stay in the folder and under the name of the proxy."""
    answer = proxy.get(f"{proxy.url}?token={proxy.web.access.tokens.user}")
    cookie, _, attributes = answer.headers["set-cookie"].partition(";")
    page = proxy.get(urljoin(proxy.url, answer.headers["location"]), Cookie=cookie)
    files = re.findall(r"""(?:src|href)=["']([^#"'][^"']*)""", page.text)

    assert (answer.status_code, page.status_code) == (303, 200)
    assert urljoin(proxy.url, answer.headers["location"]) == proxy.url
    assert "secure" in attributes.lower()
    assert "path=/" not in attributes.lower().split()  # other pages of the proxy do not get it
    found = [proxy.get(urljoin(proxy.url, file), Cookie=cookie).status_code for file in files]
    assert found == [200] * len(files)
    with proxy.socket(cookie) as connection:
        tab = Tab(connection)
        assert tab.call("/v1/goto", {"position_um": 2.5, "axis": "x"})["ok"]
        assert tab.ask(do="watch", stage="bench")["ok"]
        assert tab.event("telemetry")["axes"].keys() == {"x", "y"}


@pytest.mark.parametrize("origin", ["http://lab.example", "https://evil.example", "null"])
def test_socket_of_another_page_is_refused_behind_a_proxy(proxy: Proxy, origin: str) -> None:
    """Neither another site nor a page of the proxy without TLS may use the stage."""
    answer = proxy.get(f"{proxy.url}?token={proxy.web.access.tokens.user}")
    port = f":{proxy.port}" if "lab" in origin else ""

    with pytest.raises(InvalidStatus) as refused:
        proxy.socket(answer.headers["set-cookie"].partition(";")[0], f"{origin}{port}")
    assert refused.value.response.status_code == 403


def test_client_works_behind_a_proxy(
    proxy: Proxy, daemon: Served, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Telemetry and setpoints are not held up, and a session ends with its client."""
    token = tmp_path / "token"
    token.touch(0o600)
    token.write_text(proxy.web.access.tokens.user)
    monkeypatch.setenv("PIEZOD_TOKEN_FILE", str(token))
    monkeypatch.setenv("PIEZOD_CA", str(proxy.certificate.file))
    with closing(StageClient(f"{proxy.url}stages/bench", name="lab")) as stage:
        with closing(stage.telemetry(50.0, ["y"])) as intervals:
            assert [*next(intervals).axes] == ["y"]

        def setpoints() -> Iterator[dict[str, float]]:
            yield {"x": 1.0}
            eventually(lambda: daemon.stage.setpoints == [{"x": 1.0}])  # before the end
            yield {"x": 2.0}

        assert stage.stream(setpoints()).setpoints == 2
        with stage.session():
            assert stage.goto(2.5, axis="x").motion == 7
        eventually(lambda: requests.Stop() in daemon.stage.requests)
    assert {each.peer.client for each in daemon.stage.audited} == {"lab@127.0.0.1"}


@pytest.mark.parametrize("path", ["/", "/piezod/"])
def test_a_proxy_may_leave_the_path_and_change_the_host(
    web: Web, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The origin of the public address suffices, as do the local address and other computers."""
    public = PublicUrl.of("https://lab.example:443/piezod")
    monkeypatch.setattr(web.access, "public", public)
    answer = web.request("GET", f"{path}?token={web.access.tokens.user}")
    cookie = answer.headers["set-cookie"].partition(";")[0]

    assert (str(public), public.origin) == ("https://lab.example/piezod/", "https://lab.example")
    assert answer.status_code == 303
    with web.socket(cookie=cookie, origin=public.origin) as connection:
        assert Tab(connection).ask(do="stages")["ok"]


@pytest.mark.parametrize("trusted", [True, False])
def test_a_proxy_tells_the_address_of_a_client(
    web: Web, trusted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two computers share no lease; what a client itself puts in front counts for nothing."""
    if trusted:
        monkeypatch.setattr(web.access, "public", PublicUrl.of("https://lab.example/"))
    forwarded = {"X-Forwarded-For": "10.0.0.1, 192.168.1.7"}
    bearer = {"Authorization": f"Bearer {web.access.tokens.user}", "X-Piezod-Client": "lab"}
    answer = httpx.post(f"http://{web.host}/v1/lease", json={}, headers={**bearer, **forwarded})

    address = "192.168.1.7" if trusted else "127.0.0.1"
    assert answer.json()["holder"]["client"] == f"lab@{address}"


@pytest.mark.parametrize(
    "url",
    ["lab.example", "ftp://lab.example/", "https:///piezod/", "https://lab.example/?token=a",
     "https://lab.example:99999/", "https://me@lab.example/", "https://lab.example/#a", ""],
)  # fmt: skip
def test_public_url_that_is_none_is_refused(url: str) -> None:
    """The text names it, and shows one that is right."""
    with pytest.raises(PiezodError, match="like https://"):
        PublicUrl.of(url)
