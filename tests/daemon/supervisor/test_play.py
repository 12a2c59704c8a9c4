"""A table that the simulated rig plays while a daemon runs it."""

from math import pi, sin
from pathlib import Path

from tests.daemon.conftest import StartDaemon

POINTS, CYCLES, INTERVAL_S = 100, 4, 1e-4
TABLE_V = [40.0 + 30.0 * sin(2.0 * pi * k / POINTS) for k in range(POINTS)]


def test_table_is_played_and_its_record_is_served(rig_file: Path, start: StartDaemon) -> None:
    """The record has a sample for each point, and the stage is ready again."""
    daemon = start(rig_file)
    daemon.until("SAFE")
    before = daemon.ask("GET", "play")
    daemon.do("arm")
    daemon.do("play", drive_v=TABLE_V, interval_s=INTERVAL_S, cycles=CYCLES)
    daemon.until("READY")
    played = daemon.ask("GET", "play").json()
    position_um = played["position_um"][-POINTS:]

    assert before.status_code == 404
    assert played["failed"] == ""
    assert len(played["position_um"]) == POINTS * CYCLES
    assert max(position_um) - min(position_um) > 3.0
