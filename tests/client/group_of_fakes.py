"""A group of fake daemons, found by the names of their stages."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.client.fake_daemon import STATUS, FakeDaemon

NAMES = ("fast", "slow")
Daemons = dict[str, FakeDaemon]


@pytest.fixture
def daemons(monkeypatch: pytest.MonkeyPatch) -> Iterator[Daemons]:
    """Return the daemons of the group `raster`, in SAFE; they accept everything."""
    # The path of a socket must be short, and pytest's folders have long ones.
    folder = Path(tempfile.mkdtemp(prefix="pz-"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("PIEZOD_GROUPS", str(folder / "groups.yaml"))
    for variable in ("PIEZOD_STAGE", "PIEZOD_SOCKET"):
        monkeypatch.delenv(variable, raising=False)
    (folder / "groups.yaml").write_text(f"groups: {{raster: [{', '.join(NAMES)}]}}\n")
    with ExitStack() as running:
        found = {}
        for name in NAMES:
            (folder / "piezod" / name).mkdir(parents=True)
            daemon = found[name] = FakeDaemon(folder / "piezod" / name / "api.sock")
            daemon.answers["GET status"] = {**STATUS, "stage": name, "state": "SAFE", "lease": None}
            running.enter_context(daemon.running())
        yield found
    shutil.rmtree(folder)


def asked(daemon: FakeDaemon) -> list[str]:
    """Return the requests to a daemon, without those that only look."""
    return [each.what for each in daemon.asked if not each.what.startswith("GET")]
