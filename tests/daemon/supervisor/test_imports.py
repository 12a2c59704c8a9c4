"""The libraries that a supervisor loads, which decide how much memory it needs."""

import json
import subprocess
import sys
from pathlib import Path

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.daemon import accepted_config
from piezod.devices import registry

SIMULATED = Path(__file__).parents[3] / "config" / "simulated.yaml"
AT_REST = """
import asyncio, sys
from pathlib import Path
import piezod.daemon.supervisor.run
import piezod.daemon.supervisor.supervisor
from piezod.config.states import State
from piezod.daemon import accepted_config
from piezod.daemon.service.app import create_app
from piezod.daemon.service.roles import GroupRoles
from tests.daemon.bench import Bench

folder, document = Path(sys.argv[1]), sys.stdin.read()
bench = Bench(folder, accepted_config.parsed(document, folder / "rig.yaml"))
create_app(bench.link, GroupRoles(0, lambda: 0.0))
bench.record(State.READY, position_um=1.0)
bench.link.status(), bench.link.faults(), bench.link.report_faults()
asyncio.run(bench.link.params())
asyncio.run(bench.link.stage_recordings.write_flight(bench.loop))
bench.loop.ended_at_safe_voltage()
heavy = {"h5py", "httpx", "jinja2", "matplotlib", "numba", "numpy", "pygments", "rich", "scipy"}
print(sorted(heavy & set(sys.modules)))
bench.link.open_reader().read(1)
print(sorted(heavy & set(sys.modules)))
"""


def test_supervisor_at_rest_loads_little(tmp_path: Path) -> None:
    """Status, parameters and the log need neither numpy nor rich; telemetry needs numpy."""
    config: DaemonConfig = load_daemon(SIMULATED, registry)

    done = subprocess.run(
        [sys.executable, "-c", AT_REST, str(tmp_path)],
        input=json.dumps(accepted_config.document(config)),
        capture_output=True,
        check=True,
        text=True,
        cwd=Path(__file__).parents[3],
    )

    assert done.stdout.splitlines() == ["[]", "['numpy']"]


def test_rich_can_be_imported_after_the_log() -> None:
    """The log leaves rich out of structlog alone."""
    code = "import piezod.daemon.logging, rich.console; print(rich.console.Console)"

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)

    assert done.stdout == b"<class 'rich.console.Console'>\n"
