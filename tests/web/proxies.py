"""Reverse proxies by others in front of `piezod web`, configured as docs/remote.md has it."""

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from socket import create_connection, create_server

import pytest

from piezod.web.encryption import Certificate
from tests.daemon.waiting import eventually

PAGE = Path(__file__).parents[2] / "docs" / "remote.md"
NAME = "lab.example"
PATH = "/piezod/"


def free_port() -> int:
    """Return a port that nobody uses."""
    with create_server(("127.0.0.1", 0)) as endpoint:
        port: int = endpoint.getsockname()[1]
        return port


@contextmanager
def running(
    program: str, folder: Path, certificate: Certificate, port: int, web_port: int
) -> Iterator[None]:
    """Run a proxy until the end of the block; skip the test where it is not installed.

    Args:
        program: "nginx" or "caddy".
        folder: A folder for its files.
        certificate: Its certificate.
        port: Its port, with TLS.
        web_port: The port of `piezod web`.
    """
    path = which(program) or which(program, path="/usr/sbin")  # not in the PATH of all users
    if path is None:
        pytest.skip(f"this machine has no {program}: install Debian's package of this name")
    text = _documented(program, certificate, port, web_port)
    file = folder / f"{program}.conf"
    if program == "nginx":
        parts = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        folders = "".join(f"{part}_temp_path {folder / part};\n" for part in parts)
        text = (
            f"daemon off;\nmaster_process off;\npid {folder / 'pid'};\nevents {{}}\n"
            f"http {{\naccess_log off;\n{folders}{text}}}\n"
        )
        command = [path, "-e", str(folder / "nginx.log"), "-c", str(file)]
    else:
        text = f"{{\nadmin off\nauto_https disable_redirects\n}}\n{text}"
        command = [path, "run", "--adapter", "caddyfile", "--config", str(file)]
    file.write_text(text, encoding="ascii")
    with (folder / f"{program}.out").open("w") as out:
        process = subprocess.Popen(
            command, stdout=out, stderr=out, env={"HOME": str(folder), "PATH": "/usr/bin"}
        )
    try:
        eventually(lambda: process.poll() is not None or _listens(port), 30.0)
        assert process.poll() is None, (folder / f"{program}.out").read_text()
        yield
    finally:
        process.terminate()
        process.wait(20.0)


def _documented(program: str, certificate: Certificate, port: int, web_port: int) -> str:
    """Return the configuration of the page, with other ports and files."""
    language = {"nginx": "nginx", "caddy": "caddyfile"}[program]
    text: str
    (text,) = re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    text = text.replace("127.0.0.1:8080", f"127.0.0.1:{web_port}")
    text = text.replace("/etc/ssl/lab.example.crt", str(certificate.file))
    text = text.replace("/etc/ssl/lab.example.key", str(certificate.key))
    text = text.replace("listen 443", f"listen 127.0.0.1:{port}")
    return text.replace(f"{NAME} {{", f"{NAME}:{port} {{")


def _listens(port: int) -> bool:
    try:
        create_connection(("127.0.0.1", port)).close()
    except OSError:
        return False
    return True
