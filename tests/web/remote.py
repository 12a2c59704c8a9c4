"""Another computer: certificates, and what it sends to `piezod web` over TLS."""

import json
import socket
import ssl
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from typing import Any

import httpx
import pytest

from piezod.web.encryption import Certificate
from tests.web.browser import Web


def new_certificate(folder: Path, names: str = "DNS:localhost,IP:127.0.0.1") -> Certificate:
    """Make a self-signed certificate by the command of docs/remote.md.

    Args:
        folder: A folder for its files.
        names: Names of the server.
    """
    if which("openssl") is None:
        pytest.skip("this machine has no openssl to make a certificate")
    made = Certificate(folder / "labpc.crt", folder / "labpc.key")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    options = ("-days", "825", "-subj", "/CN=labpc", "-addext", f"subjectAltName={names}")
    files = ("-keyout", str(made.key), "-out", str(made.file))
    subprocess.run(
        ["openssl", "req", "-x509", *key, *options, *files],  # noqa: S607 - the documented command
        check=True,
        capture_output=True,
    )
    return made


class Remote:
    """A program on another computer that has the certificate.

    Args:
        web: The server.
        folder: A folder for its files.
    """

    def __init__(self, web: Web, folder: Path) -> None:
        assert web.certificate is not None
        self.web, self.url = web, f"https://127.0.0.1:{web.port}"
        self.trusted = ssl.create_default_context(cafile=web.certificate.file)
        self._token_file = folder / "token"

    @contextmanager
    def connection(self) -> Iterator[ssl.SSLSocket]:
        """Yield an encrypted connection on which nothing was sent."""
        address = ("127.0.0.1", self.web.port)
        with (
            socket.create_connection(address, timeout=20.0) as plain,
            self.trusted.wrap_socket(plain, server_hostname=address[0]) as encrypted,
        ):
            yield encrypted

    def environ(self, token: str | None = None) -> dict[str, str]:
        """Return the environment of a client; by default with the token of the user."""
        self._token_file.touch(0o600)
        self._token_file.write_text(f"{token or self.web.access.tokens.user}\n", encoding="ascii")
        assert self.web.certificate is not None
        return {
            "PIEZOD_TOKEN_FILE": str(self._token_file),
            "PIEZOD_CA": str(self.web.certificate.file),
            "PIEZOD_STAGE": f"{self.url}/stages/bench",
        }

    def request(
        self, method: str, path: str, token: str = "", body: Any = None, **headers: str
    ) -> httpx.Response:
        """Send a request, with the header `Authorization` if there is a token."""
        given: Mapping[str, str] = {"Authorization": f"Bearer {token}"} if token else {}
        content = None if body is None else json.dumps(body)
        kind = {"Content-Type": "application/json"} if content else {}
        with httpx.Client(verify=self.trusted, timeout=20) as client:
            return client.request(
                method, f"{self.url}{path}", headers={**given, **kind, **headers}, content=content
            )
