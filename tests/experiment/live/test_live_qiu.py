"""The paper's experiment on a running stage, in real time, with the errors of virtual time."""

import json
import re
from pathlib import Path

import pytest

from piezod.config.modes import Mode
from tests.conftest import Figure
from tests.daemon.daemons import SHIPPED, Daemon
from tests.experiment.virtual.test_qiu import PAPER_PCT, QIU

MODES = "modes: [feedforward, adaptive]"
METRICS = ("tracking_max_pct", "nonlinearity_pct")


@pytest.mark.stress
@pytest.mark.timeout(900)
def test_errors_are_below_those_of_the_paper(tmp_path: Path, figure: Figure) -> None:
    """Worst tracking error and nonlinearity in every case, on the stage of the repository."""
    text, count = re.subn("^modes: .*$", MODES, QIU.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert count == 1
    (tmp_path / "qiu.yaml").write_text(text, encoding="utf-8")

    with Daemon(SHIPPED) as daemon:
        daemon.up()
        files = str(tmp_path / "qiu.yaml"), "--out", str(tmp_path / "out")
        ended = daemon.command("experiment", *files, "--live", "--json")

    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    assert len(document["cases"]) == 6
    for run in document["cases"]:
        paper_pct = PAPER_PCT[run["case"], Mode(run["mode"])]
        figure(
            f"live, {run['case']}, {run['mode']}: tracking {run['tracking_max_pct']:.2f} %, "
            f"nonlinearity {run['nonlinearity_pct']:.2f} %, paper {paper_pct:.2f} %"
        )
    for warning in document["warnings"][1:]:
        figure(f"live, {warning}")
    for run in document["cases"]:
        assert max(run[metric] for metric in METRICS) <= PAPER_PCT[run["case"], Mode(run["mode"])]
