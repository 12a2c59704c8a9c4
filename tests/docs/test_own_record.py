"""The notebook about a record of one's own."""

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.docs.blocks import ROOT

NOTEBOOK = ROOT / "docs" / "own-record.ipynb"


def test_notebook_leads_from_a_file_to_voltages_and_code(tmp_path: Path) -> None:
    """All its cells run, its voltages lead to the trajectory, and its C file is written."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    program = "\n".join("".join(each["source"]) for each in cells if each["cell_type"] == "code")
    program += "\nprint('worst', worst_um, (folder / 'axis.c').exists(), model.rate_hz)"
    environ = {
        **os.environ,
        "MPLBACKEND": "Agg",
        "TMPDIR": str(tmp_path),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env=environ,
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stdout + done.stderr
    _, worst_um, written, rate_hz = done.stdout.splitlines()[-1].split()
    assert float(worst_um) < 0.5
    assert written == "True"
    assert float(rate_hz) > 0.0
