"""A loop that compiles its kernels, and the service manager."""

import os
import socket
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.daemon.supervisor.run_rig import Rig

COMPILING_LOOP = """
import time
from pathlib import Path
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import Word
from tests.daemon.fake_loop import FakeLoop, accept
accept(Path({source!r}), Path({copy!r}))
shared = attach(Path({map!r}), writable=True)
shared.words[Word.COMPILED_KERNELS] = 7
while not Path("told").exists():
    time.sleep(0.01)
FakeLoop(shared).run()
"""


def test_service_manager_waits_while_the_loop_compiles(
    rig: Rig, manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While kernels are compiled, the manager is told so and given more time."""
    monkeypatch.setenv("NOTIFY_SOCKET", manager.getsockname())
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    paths = {"copy": rig.paths.runtime / "config-a" / "rig.yaml", "map": rig.paths.loop_map}
    texts = {name: str(path) for name, path in paths.items()}
    rig.loop_code[:] = [COMPILING_LOOP.format(source=str(rig.config), **texts)]

    def told() -> str:
        while b"EXTEND_TIMEOUT_USEC" not in (message := manager.recv(1000)):
            pass
        Path("told").touch()
        return message.decode()

    with ThreadPoolExecutor(1) as beside:
        message = beside.submit(told)
        assert rig.run(lambda: None)
    assert "compiling" in message.result()
    assert "7" in message.result()
