"""The paper's experiment on a running stage, in real time: the same figures as in virtual time."""

import pytest

from piezod.client import StageClient
from piezod.config.experiment import load_experiment
from piezod.config.modes import Mode
from piezod.devices import registry
from piezod.experiment.live_run import run_live
from tests.conftest import Figure
from tests.daemon.daemons import SHIPPED, Daemon
from tests.experiment.test_qiu import PAPER_PCT, QIU

MODES = (Mode.FEEDFORWARD, Mode.ADAPTIVE)


@pytest.mark.stress
@pytest.mark.timeout(900)
def test_the_errors_are_below_the_papers(figure: Figure) -> None:
    """Worst tracking error and nonlinearity in every case, on the stage that is shipped."""
    config = load_experiment(QIU, registry).model_copy(update={"modes": MODES})

    with Daemon(SHIPPED) as daemon, StageClient(socket=daemon.up().paths.api_socket) as client:
        result = run_live(config, "", "qiu", client, lambda _label, _share: None)

    for recording in result.recordings:
        paper_pct = PAPER_PCT[recording.case, Mode(recording.mode)]
        tracking_pct = recording.metrics["tracking_max_pct"]
        nonlinearity_pct = recording.metrics["nonlinearity_pct"]
        figure(
            f"live, {recording.case}, {recording.mode}: tracking {tracking_pct:.2f} %, "
            f"nonlinearity {nonlinearity_pct:.2f} %, paper {paper_pct:.2f} %"
        )
    for recording in result.recordings:
        paper_pct = PAPER_PCT[recording.case, Mode(recording.mode)]
        assert recording.metrics["tracking_max_pct"] <= paper_pct
        assert recording.metrics["nonlinearity_pct"] <= paper_pct
