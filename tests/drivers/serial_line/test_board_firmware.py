"""The firmware of the player board: its core on this machine, and two channels of it."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Table
from piezod_drivers.serial_line.piezo_board.driver import make_device
from piezod_drivers.serial_line.piezo_board.emulation.build import sources
from piezod_drivers.serial_line.piezo_board.emulator import BoardEmulator
from piezod_drivers.serial_line.piezo_board.options import BoardOptions
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine

US = 1000


def made(target: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a target of the firmware's Makefile."""
    command = ["make", "-s", "-C", str(sources()), target, f"OUT={folder}"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.skipif(not (shutil.which("cc") and shutil.which("make")), reason="no C compiler")
def test_facts_of_the_core_hold(tmp_path: Path) -> None:
    """The tests of the core pass, with sanitizers for addresses and undefined behaviour."""
    done = made("test", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.stress
@pytest.mark.skipif(not shutil.which("cppcheck"), reason="cppcheck is missing")
def test_analysers_find_nothing(tmp_path: Path) -> None:
    """Neither gcc -fanalyzer nor cppcheck has anything to say about the core."""
    done = made("analyse", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@needs_board
@pytest.mark.stress
def test_two_channels_play_in_step() -> None:
    """A firmware of two channels sets both outputs at each point, and records both inputs."""
    shared, rig, time = bench(2)
    board = BoardEmulator(shared, "")
    line = EmulatedLine(board, time)
    options = BoardOptions(port="p", timeout_ms=100.0, channels=2)
    device = make_device(line, options, Wiring.both(("1", "2")))
    assert isinstance(device, PlayingBusDevice)
    device.open()
    device.activate(time.t_ns)
    assert device.write([1.0, 2.0], time.t_ns)
    assert rig.drive_v == pytest.approx([30.0, 60.0], abs=0.01)
    wave = np.stack((np.linspace(1, 3, 20), np.linspace(4, 2, 20)), axis=1)
    table = Table(75 * US, wave[:0], wave, 3)
    device.load(table)
    device.arm()
    device.start(time.t_ns)
    while (progress := device.progress(time.t_ns)).state is PlayState.PLAYING:
        time.t_ns += 20 * MS
        board.due()
    assert progress.state is PlayState.ENDED, progress
    assert rig.drive_v == pytest.approx([90.0, 60.0], abs=0.01)
    record = device.recording()
    assert record.positions.shape == (60, 2)
    # A sample shows the point before: the displacement is 0.2 µm/V, the input 8 µm/V from -5 µm.
    shown = (wave[:-1] * 30.0 * 0.2 + 5.0) / 8.0
    assert record.positions[1:20] == pytest.approx(shown, abs=1e-3)
