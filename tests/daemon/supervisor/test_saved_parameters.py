"""A run begins with the parameters that the last run saved."""

from pathlib import Path

from tests.daemon.daemons import Daemon, configuration
from tests.daemon.waiting import eventually


def test_the_next_run_begins_with_the_saved_parameters(tmp_path: Path) -> None:
    """The sensor zero of a run is in force in the next one."""
    with Daemon(configuration(tmp_path)) as daemon:
        daemon.up().do("zero")
        zero_um = eventually(daemon.zero_um)
        saved = daemon.do("params/save")
        daemon.do("shutdown")
        daemon.exit_code()
        daemon.start()
        daemon.up()

        assert eventually(daemon.zero_um) == zero_um
        assert daemon.ask("GET", "params").json()["sequence"] == saved["sequence"]
