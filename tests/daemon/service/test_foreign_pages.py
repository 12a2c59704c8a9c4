"""What a web page can do to a socket that somebody has forwarded to a TCP port."""

import shutil
import subprocess

import httpx
import pytest

from tests.daemon.service.fakes import Served

AGENT = "Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 Chrome/156.0.0.0 Safari/537.36"
COMMANDS = ["arm", "stop", "estop"]
SIMPLE = [
    {},
    {"content-type": "text/plain"},
    {"content-type": "application/x-www-form-urlencoded"},
]
"""The content types of a POST that a browser sends across origins without asking the server."""


@pytest.fixture
def page(client: httpx.Client) -> httpx.Client:
    """Return a browser that reaches the service by a forwarded port."""
    del client.headers["x-piezod-client"]
    client.base_url = httpx.URL("http://localhost:8080/v1/")
    client.headers["user-agent"] = AGENT
    return client


def refused(served: Served, answer: httpx.Response) -> bool:
    """Return whether a request was refused as that of a foreign page."""
    error = answer.json().get("error", {})
    return (answer.status_code, error.get("code"), served.called()) == (403, "foreign_page", 0)


@pytest.mark.fault("C11")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("headers", SIMPLE)
def test_simple_post_of_a_page_is_refused(
    served: Served, page: httpx.Client, command: str, headers: dict[str, str]
) -> None:
    """A POST that needs no permission of the server is refused, with an Origin and without."""
    sent = page.post(command, headers=headers)
    across = page.post(command, headers={**headers, "origin": "http://evil.example"})

    assert refused(served, sent)
    assert refused(served, across)


@pytest.mark.fault("C11")
@pytest.mark.parametrize("origin", ["http://evil.example", "http://localhost:5000", "null"])
@pytest.mark.parametrize("command", COMMANDS)
def test_foreign_origin_is_refused(
    served: Served, page: httpx.Client, command: str, origin: str
) -> None:
    """A request from another origin is refused, even with the headers of our clients."""
    headers = {"origin": origin, "x-piezod-client": "page", "content-type": "application/json"}

    assert refused(served, page.post(command, headers=headers))
    assert refused(served, page.get("status", headers=headers))
    assert refused(served, page.delete("lease", headers=headers))


@pytest.mark.fault("C11")
@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_foreign_site_is_refused(served: Served, page: httpx.Client, site: str) -> None:
    """An image or a link of a foreign page costs no stream of telemetry."""
    assert refused(served, page.get("telemetry", headers={"sec-fetch-site": site}))


@pytest.mark.fault("C11")
@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example"])
def test_foreign_host_is_refused(served: Served, client: httpx.Client, host: str) -> None:
    """A domain name that was made to lead to this machine is refused, for reading too."""
    assert refused(served, client.get("status", headers={"host": host}))
    assert refused(served, client.post("estop", headers={"host": host}))


@pytest.mark.parametrize("host", ["piezod", "localhost:8080", "127.0.0.1:8080", "[::1]", "x"])
def test_programs_are_served(served: Served, client: httpx.Client, host: str) -> None:
    """A program may use any name without a dot, and needs neither header nor content type."""
    del client.headers["x-piezod-client"]

    assert client.get("status", headers={"host": host}).status_code == 200
    assert client.post("arm", headers={"host": host}).status_code == 200
    assert client.delete("lease", headers={"host": host}).status_code == 200
    assert served.called() == 1


def test_address_bar_shows_the_status(page: httpx.Client) -> None:
    """A browser on a forwarded port may read."""
    assert page.get("status", headers={"sec-fetch-site": "none"}).status_code == 200


@pytest.mark.skipif(shutil.which("curl") is None, reason="there is no curl")
@pytest.mark.parametrize(
    "arguments",
    [
        ["-X", "POST"],
        ["--json", "{}"],
        ["-H", "X-Piezod-Client: lab", "--json", '{"shadow": true}'],
    ],
)
def test_curl_is_served(served: Served, arguments: list[str]) -> None:
    """The commands of the documentation, and shorter ones, go on working."""
    command = ["curl", "-sS", "--fail", "--unix-socket", str(served.socket), *arguments]

    subprocess.run([*command, "http://piezod/v1/arm"], check=True, capture_output=True)

    assert served.called() == 1
