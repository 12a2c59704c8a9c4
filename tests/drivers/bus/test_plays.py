"""Devices that play tables, emulated in another process: a play, and the death of its host."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Progress
from piezod.errors import DeviceError
from piezod_drivers.modbus.stream_arrays import FloatArray
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import emulated
from tests.drivers.bus.played_table import (
    N_POINTS,
    SETTLING,
    long_sine,
    make,
    sine,
    start,
)
from tests.forked import Piped

MS = 1_000_000
CYCLES = 20


class Player(NamedTuple):
    """A device that plays."""

    profile: str  #: Its emulator.
    driver: str  #: Its driver.
    options: dict[str, object]  #: Options of the driver.
    wiring: Wiring  #: Its channels.
    #: Calibration of its output to V, as in a configuration.
    calibration: str = "{kind: line, gain: 1}"
    n_lead_in: int = 200  #: Points of the lead-in.

    def options_at(self, where: str) -> dict[str, object]:
        """Return the options for a place that an emulator prints."""
        if where.startswith("/"):
            return {**self.options, "port": where}
        host, _, port = where.rpartition(":")
        return {**self.options, "host": host, "tcp_port": int(port)}


SLOW: dict[str, object] = {"timeout_ms": 2000.0}
LABJACK = Player(
    "labjack-t7",
    "modbus",
    {"profile": "labjack-t7", **SLOW},
    Wiring(("AIN0",), ("DAC0",)),
    "{kind: line, gain: 30}",
)
PI_TCP = Player("pi-gcs2-tcp", "pi_gcs2", SLOW, Wiring.both(("1",)))
PI = PI_TCP._replace(profile="pi-gcs2")
LC400 = Player(
    "lc400",
    "npoint_lc400",
    SLOW,
    Wiring.both(("1",)),
    "{kind: line, gain: 1.5, offset: 75}",
    4000,  # it plays on until the host ends it, which must happen within the next lead-in
)
NV200_TCP = Player(
    "psj-nv200-tcp",
    "psj",
    {"profile": "nv200", "wave_end": "holds", **SLOW},
    Wiring.both(("ch0",)),
)
NV200 = NV200_TCP._replace(profile="psj-nv200")


def play(player: Player, where: str) -> tuple[FloatArray, FloatArray]:
    """Play a sine; return table and record of each settled cycle, shape (cycles, points)."""
    device = make(player.driver, player.options_at(where), player.wiring)
    table = start(device, sine(device, CYCLES, player.n_lead_in))
    progress = eventually(lambda: _ended(device.progress(time.monotonic_ns())))
    assert progress == (PlayState.ENDED, CYCLES, "")
    record = device.recording()
    assert (record.interval_ns, record.first_point) == (table.interval_ns, 0)
    device.close()
    cycles = record.positions[player.n_lead_in :, 0].reshape(CYCLES, N_POINTS)
    return table.period[:, 0], cycles[SETTLING:]


def _ended(progress: Progress) -> Progress | None:
    return None if progress.state is PlayState.PLAYING else progress


def lag_points(table: FloatArray, record: FloatArray) -> FloatArray:
    """Return by how many points each cycle of a record lags its table."""
    first = np.fft.rfft(record, axis=1)[:, 1] / np.fft.rfft(table)[1]
    return np.asarray(-np.angle(first) * N_POINTS / (2 * np.pi))


@pytest.mark.parametrize(
    "player", [LABJACK, PI_TCP, PI, LC400, NV200], ids=lambda each: each.profile
)
def test_record_is_in_step_with_the_table(player: Player) -> None:
    """Every cycle of the record has the same lag, and a second play has it to within a point."""
    with emulated(player.profile) as devices:
        table, first = play(player, devices.where[0])
        _, second = play(player, devices.where[0])
    lags = np.stack((lag_points(table, first), lag_points(table, second)))
    # The stage lags by 0.6 ms, which are 8 to 12 points; its hysteresis and amplifier add to it.
    assert np.all((lags > 10) & (lags < 30))
    assert np.all(np.ptp(lags, axis=1) < 0.5)
    assert np.ptp(lags) < 1.0
    assert np.std(first - first.mean(axis=0)) < 0.01 * np.ptp(first)


@contextmanager
def host(player: Player, where: str) -> Iterator[Piped]:
    """Run a process that plays; it is killed at the end."""
    what = player.driver, json.dumps(player.options_at(where)), player.wiring.outputs[0]
    process = Piped(what, "tests.drivers.bus.played_table")
    with process.stdin, process.stdout:
        try:
            assert process.stdout.readline() == "playing\n"
            yield process
        finally:
            process.kill()
            process.wait()


def writes(trace: Path) -> list[tuple[int, float]]:
    """Return instant in ns and voltage of everything that was written to the rig."""
    rows = [line.split(",") for line in trace.read_text(encoding="ascii").splitlines()[1:]]
    return [(int(row[0]), float(row[3])) for row in rows if len(row) == 4 and row[3]]


STAGE = """
rate_hz: 100
devices:
  player: {{driver: {driver}, options: {options}}}
axes:
  x:
    amplifier: {{device: player, channel: "{output}", calibration: {calibration}}}
    sensor: {{device: player, channel: "{input}", calibration: {{kind: line, gain: 5}}}}
    limits: {{drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}}
    command_range_um: [0, 26]
    safety: {{safe_v: 10, ramp_v_per_s: 200}}
"""
SAFE = """if True:
    import sys
    from piezod.cli import main
    sys.argv = ["piezod", "safe", "stage.yaml"]
    try:
        main.run()
    finally:
        print(sorted({"numpy", "numba", "scipy"} & set(sys.modules)))
"""


@pytest.mark.parametrize(
    "player", [LABJACK, PI_TCP, LC400, NV200_TCP], ids=lambda each: each.profile
)
@pytest.mark.few(2)
def test_safe_stops_the_play_of_a_killed_host(player: Player, tmp_path: Path) -> None:
    """The device plays on alone. `piezod safe` stops it, and ramps from where it stands.

    It does so without numpy.
    """
    trace = tmp_path / "trace.csv"
    with emulated(player.profile, arguments=("--trace", str(trace))) as devices:
        with host(player, devices.where[0]):
            pass
        n_before = len(writes(trace))
        eventually(lambda: len(writes(trace)) > n_before + 1000)
        stage = STAGE.format(
            driver=player.driver,
            options=json.dumps(player.options_at(devices.where[0])),
            output=player.wiring.outputs[0],
            input=player.wiring.inputs[0],
            calibration=player.calibration,
        )
        (tmp_path / "stage.yaml").write_text(stage, encoding="utf-8")
        folders = {"RUNTIME_DIRECTORY": str(tmp_path / "r"), "STATE_DIRECTORY": str(tmp_path / "s")}
        done = subprocess.run(
            [sys.executable, "-c", SAFE],
            cwd=tmp_path,
            env=folders,
            capture_output=True,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    rows = writes(trace)
    # The steps of the ramp are at least 9 ms apart, the points of the table 50 µs.
    gaps_ns = [b - a for (a, _), (b, _) in pairwise(rows)]
    last_point = max(i for i, gap_ns in enumerate(gaps_ns) if gap_ns < MS) + 1
    ramp_v = [drive_v for _, drive_v in rows[last_point:]]
    assert len(ramp_v) > 10
    # 2 V for each step, and the steps of the converters.
    assert max(abs(b - a) for a, b in pairwise(ramp_v)) < 2.1
    assert ramp_v[-1] == pytest.approx(10, abs=0.05)


@pytest.mark.parametrize(
    "player", [LABJACK, PI_TCP, LC400, NV200_TCP], ids=lambda each: each.profile
)
def test_pulled_cable_in_mid_play(player: Player) -> None:
    """The play fails, the voltage is unknown; opened again, the device has stopped and holds."""
    with emulated(player.profile) as devices:
        device = make(player.driver, player.options_at(devices.where[0]), player.wiring)
        start(device, long_sine(device))
        eventually(lambda: device.progress(time.monotonic_ns()).cycle > 3)
        devices.faults("disconnect:now:0.3")
        failed = eventually(lambda: _ended(device.progress(time.monotonic_ns())))
        assert failed is not None
        assert failed.state is PlayState.FAILED
        assert np.isnan(device.abort(time.monotonic_ns())[0])
        device.close()
        eventually(lambda: _opens(player, devices.where[0]))
        again = make(player.driver, player.options_at(devices.where[0]), player.wiring)
        (value,) = again.read_back(time.monotonic_ns())
        assert again.write([value], time.monotonic_ns())
        assert list(again.read_back(time.monotonic_ns())) == pytest.approx([value], rel=0.02)
        again.close()


def _opens(player: Player, where: str) -> bool:
    try:
        make(player.driver, player.options_at(where), player.wiring).close()
    except DeviceError:
        return False
    return True
