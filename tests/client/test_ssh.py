"""A client on another computer, over a socket that ssh forwards."""

import getpass
import os
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from shutil import which

import numpy as np
import pytest

from piezod.client import StageClient
from piezod.daemon.service.connection import ConnectionLimits
from piezod.messages import requests
from piezod.telemetry.arrays import record_dtype
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.stress  # a server of its own, and two key exchanges
PATH = f"{os.environ['PATH']}:/usr/sbin:/usr/local/sbin"


@pytest.fixture
def short() -> Iterator[Path]:
    """Return a folder with a short path, as sockets need it."""
    folder = Path(tempfile.mkdtemp(prefix="pz-"))
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
def port(short: Path) -> Iterator[int]:
    """Return the port of an ssh server for the user of this process."""
    programs = [which(each, path=PATH) for each in ("sshd", "ssh", "ssh-keygen")]
    if None in programs:
        pytest.skip("this machine has no sshd, ssh and ssh-keygen (Debian: openssh-server)")
    for name in ("host", "user"):
        _run("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(short / name))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
    public = (short / "host.pub").read_text(encoding="ascii")
    (short / "known").write_text(f"[127.0.0.1]:{port} {public}", encoding="ascii")
    (short / "config").write_text(
        f"ListenAddress 127.0.0.1:{port}\nHostKey {short}/host\n"
        f"AuthorizedKeysFile {short}/user.pub\n"
        "PidFile none\nUsePAM no\nStrictModes no\nPasswordAuthentication no\n",
        encoding="ascii",
    )
    server = (str(which("sshd", path=PATH)), "-f", str(short / "config"))
    tried = subprocess.run([*server, "-t"], capture_output=True, text=True, check=False)
    if tried.returncode:
        pytest.skip(f"sshd does not run here: {tried.stderr.strip()}")
    with _started(*server, "-D", "-e") as running:
        eventually(lambda: _listens(port) or running.poll() is not None)
        yield port


@pytest.fixture
def served(short: Path) -> Iterator[Served]:
    """Return a service whose stage accepts everything."""
    (short / "far").mkdir()
    served = Served(short / "far", ConnectionLimits())
    served.stage.reader.else_ = np.zeros(1, record_dtype(2))
    with served.running():
        yield served


def test_stage_is_used_over_a_forwarded_socket(port: int, short: Path, served: Served) -> None:
    """Commands, telemetry and sessions pass; the daemon sees the user who has logged in."""
    near = short / "near.sock"
    options = ("UserKnownHostsFile=" + str(short / "known"), "ExitOnForwardFailure=yes")
    with _started(
        str(which("ssh")), "-F", "none", "-i", str(short / "user"), "-p", str(port), "-N",
        *(word for each in options for word in ("-o", each)),
        "-L", f"{near}:{served.socket}", f"{getpass.getuser()}@127.0.0.1",
    ) as ssh:  # fmt: skip
        eventually(lambda: near.exists() or ssh.poll() is not None)
        stage = StageClient(socket=near, name="laptop")
        assert stage.status().state == "SAFE"
        stage.goto(2.0, axis="x")
        with closing(stage.telemetry(50.0)) as intervals:
            assert {*next(intervals).axes} == {"x", "y"}
        peer = served.stage.audited[0].peer
        assert (peer.client, peer.uid) == ("laptop", os.getuid())
        assert peer.pid not in (os.getpid(), ssh.pid)  # that of sshd

        session = stage.session()
        session.__enter__()
        assert served.stage.requests == [requests.Goto(position_um=2.0, axis="x")]
        ssh.send_signal(signal.SIGKILL)
        eventually(lambda: served.stage.requests[1:] == [requests.Stop()])
        stage.close()


@contextmanager
def _started(*command: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Run a program while the block runs."""
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.terminate()


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


def _listens(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
        return True
    return False
