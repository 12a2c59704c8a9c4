"""A stop while a table is loaded, or its record is read, over a slow bus."""

from collections.abc import Iterator
from math import pi, sin
from pathlib import Path

import numpy as np
import pytest

from piezod.config.states import State
from piezod.daemon.stage.status import STATES
from piezod.telemetry.arrays import RingReader
from piezod.telemetry.shared_map import attach
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import EXAMPLE, Daemon, device_configuration
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import Emulated, emulated

RATE_HZ = 20
POINTS = 8000
TABLE_V = [10.0 - 10.0 * sin(2.0 * pi * k / POINTS + pi / 2.0) for k in range(POINTS)]
SLOW = "late:1-:0.5"
"""A record is 40 exchanges: 20 s, if nothing ends them."""
SLOW_SOON = "late:200-:0.5"
"""The loop can take the request; the rest of the 440 exchanges of a table takes 120 s or more."""
LONGEST_S = 15.0
CYCLES_UNDER_WAY = 2 * RATE_HZ
"""The play has the device for longer than for the exchanges before the first points."""


@pytest.fixture
def player(start: StartDaemon, tmp_path: Path) -> Iterator[tuple[Daemon, Emulated, Path]]:
    """Yield a daemon that is armed, its emulated device, and the trace of the outputs."""
    trace = tmp_path / "trace.csv"
    changes = {"timeout_ms: 30": "timeout_ms: 5000\n      wave_end: holds"}
    changes["rate_hz: 150"] = f"rate_hz: {RATE_HZ}"
    with emulated("pi-gcs2", arguments=("--trace", str(trace))) as far:
        changes[EXAMPLE] = far.where[0]
        daemon = start(device_configuration(tmp_path, "pi-gcs2", changes)).up()
        daemon.do("arm")
        daemon.until("READY")
        yield daemon, far, trace


def play(daemon: Daemon) -> None:
    """Play the table once."""
    daemon.do("play", drive_v=TABLE_V, interval_s=1e-4, cycles=1)


def has_the_device(daemon: Daemon) -> bool:
    """Return whether a play has had the device for the last cycles."""
    records = RingReader(attach(daemon.paths.loop_map)).last(CYCLES_UNDER_WAY)
    silent = np.isnan(records["axes"]["read_back_v"][:, 0])
    playing = records["state"] == STATES.index(State.IDENT)
    return len(records) == CYCLES_UNDER_WAY and bool(np.all(silent & playing))


def stop_slowly(daemon: Daemon, far: Emulated) -> None:
    """Stop; when the play has given the device back, let the bus be fast again."""
    daemon.do("stop")
    eventually(lambda: daemon.status()["axes"]["x"]["read_back_v"] is not None, LONGEST_S)
    far.faults()
    daemon.until("SAFE")
    assert daemon.ask("GET", "play").json()["failed"] == "it was aborted"


def assert_plays(daemon: Daemon) -> None:
    """Assert that a whole table is played now: the bus is in step."""
    # The first cycles after the play had a slow bus; a loop that stood still is not armed at once.
    eventually(lambda: daemon.ask("POST", "arm", {}).status_code == 200)
    play(daemon)
    daemon.until("READY")
    played = daemon.ask("GET", "play").json()
    assert (played["failed"], len(played["position_um"])) == ("", POINTS)


def test_a_stop_does_not_wait_for_the_rest_of_a_table(
    player: tuple[Daemon, Emulated, Path],
) -> None:
    """The stage is SAFE after one more exchange; afterwards a table is played as ever."""
    daemon, far, _ = player
    far.faults(SLOW_SOON)
    play(daemon)
    eventually(lambda: has_the_device(daemon))
    stop_slowly(daemon, far)

    assert_plays(daemon)


def test_a_stop_does_not_wait_for_the_rest_of_a_record(
    player: tuple[Daemon, Emulated, Path],
) -> None:
    """The stage is SAFE after one more exchange, from the end of the table."""
    daemon, far, trace = player
    before = len(trace.read_text(encoding="ascii").splitlines())
    play(daemon)
    eventually(lambda: len(trace.read_text(encoding="ascii").splitlines()) - before > POINTS)
    far.faults(SLOW)
    eventually(lambda: has_the_device(daemon))
    stop_slowly(daemon, far)

    assert_plays(daemon)
