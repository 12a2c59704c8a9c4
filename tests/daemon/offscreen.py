"""Programs of graphical toolkits in an environment of their own, without a screen."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from tests.daemon.daemons import REPOSITORY, Daemon


def reported(environment: str, script: Path, daemon: Daemon, packages: Path) -> dict[str, Any]:
    """Run a script that uses a stage; return the document that it prints last.

    `packages` is a folder with what the script also imports.
    """
    environ = {
        **os.environ,
        "HOME": str(daemon.folder),  # they write settings and logs there
        "PYTHONPATH": str(packages),
        "QT_QPA_PLATFORM": "offscreen",
        "XDG_RUNTIME_DIR": str(daemon.folder),
    }
    done = subprocess.run(
        [REPOSITORY / "build" / environment / "bin" / "python", script],
        cwd=daemon.folder,
        env=environ,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    report: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return report
