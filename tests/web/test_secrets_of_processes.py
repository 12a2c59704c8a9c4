"""Tokens and keys of real processes: daemon, server and clients of it over TLS."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.daemon.daemons import Daemon, configuration
from tests.daemon.waiting import eventually
from tests.web.remote import new_certificate

WRONG = "t" * 43


class Server:
    """`piezod web` with TLS and lasting tokens, of a user whose mask hides nothing.

    Args:
        folder: Folder for its files; only this user can read it.
        environ: Environment with the folder of the daemon.

    Attributes:
        tokens: Folder of its tokens.
        client_environ: Environment of a client that has the token in a file.
        printed: What it has printed.
        seen: Arguments of all processes of this machine while clients ran.
    """

    def __init__(self, folder: Path, environ: Mapping[str, str]) -> None:
        self.made, self.tokens = new_certificate(folder), folder / "tokens"
        self.client_environ = {
            **environ,
            "PIEZOD_CA": str(self.made.file),
            "PIEZOD_TOKEN_FILE": str(self.tokens / "user"),
        }
        self.printed, self.seen = "", set[str]()

    @contextmanager
    def running(self) -> Iterator[str]:
        """Serve while the block runs; give the address of the server."""
        options = ("--host", "0.0.0.0", "--port", "0", "--tokens", str(self.tokens))  # noqa: S104 - with TLS
        files = ("--certificate", str(self.made.file), "--key", str(self.made.key))
        with self._popen("web", *options, *files, umask=0) as process:
            assert process.stdout is not None
            self.printed = process.stdout.readline()
            yield f"https://127.0.0.1:{urlsplit(self.printed.split()[0]).port}"
            process.send_signal(signal.SIGINT)
            self.printed += process.stdout.read()
            assert process.wait(20.0) == 0

    def client(self, *arguments: str, **environ: str) -> int:
        """Run a verb of `piezod`, and look at all processes until it ends; return its exit code."""
        with self._popen(*arguments, environ=environ) as process:
            eventually(lambda: self._ended(process), 60.0)
            assert process.stdout is not None
            self.printed += process.stdout.read()
        return process.returncode

    def secrets(self) -> list[str]:
        """Return what must stay secret."""
        tokens = [(self.tokens / name).read_text().strip() for name in ("user", "viewer")]
        return [*tokens, WRONG, self.made.key.read_text().splitlines()[1]]

    def _ended(self, process: "subprocess.Popen[str]") -> bool:
        self.seen |= set(arguments_of_all())
        return process.poll() is not None

    def _popen(
        self, *arguments: str, environ: Mapping[str, str] | None = None, umask: int = -1
    ) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-m", "piezod", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**self.client_environ, **(environ or {})},
            umask=umask,
        )


def arguments_of_all() -> Iterator[str]:
    """Yield the arguments of each process of this machine."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(FileNotFoundError, ProcessLookupError):
            yield (process / "cmdline").read_bytes().replace(b"\0", b" ").decode("latin-1")


def contents_of(folder: Path) -> str:
    """Return what is in all files of a folder."""
    files = [file for file in folder.rglob("*") if file.is_file()]
    return "\n".join(file.read_bytes().decode("latin-1") for file in files)


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    """Return the daemon of a simulated stage, "rig"."""
    with Daemon(configuration(tmp_path)) as daemon:
        yield daemon.up()


def test_no_secret_leaves_the_processes(daemon: Daemon, tmp_path: Path) -> None:
    """Tokens and key are in no argument, no output, no file of the daemon, none for others.

    The server makes their files for its user alone, whatever mask the shell has set.
    """
    server = Server(tmp_path, daemon.environ)
    with server.running() as url:
        allowed = server.client("status", "--stage", url)
        moved = server.client("arm", "--stage", url)
        wrong = {"PIEZOD_TOKEN_FILE": "", "PIEZOD_TOKEN": WRONG}
        refused = server.client("arm", "--stage", url, **wrong)
        armed = daemon.until("READY")
    daemon.do("stop")
    daemon.signal(signal.SIGTERM)
    ended = daemon.exit_code()
    of_daemon = contents_of(daemon.folder)  # its log and all other files that it has written
    readable = [file for file in tmp_path.rglob("*") if file.is_file() and file.stat().st_mode & 4]
    seen = "\n".join([server.printed, *server.seen, of_daemon, *map(Path.read_text, readable)])

    assert (allowed, moved, refused, ended) == (0, 0, 77, 0)
    assert armed["state"] == "READY"
    assert f"with the token in {server.tokens}/user" in server.printed
    assert f"piezod status --stage {url}" in seen
    assert f"piezod web --host 0.0.0.0 --port 0 --tokens {server.tokens}" in seen
    assert daemon.text.splitlines()[-1] in re.sub("\x1b\\[[0-9;]*m", "", of_daemon)
    assert [each for each in server.secrets() if each in seen] == []
    assert server.tokens.stat().st_mode & 0o777 == 0o700
    modes = {file.name: file.stat().st_mode & 0o777 for file in server.tokens.iterdir()}
    assert modes == {"user": 0o600, "viewer": 0o600}
