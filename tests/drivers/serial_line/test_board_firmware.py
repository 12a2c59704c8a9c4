"""The firmware of the player board: its core on this machine, and two channels of it."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Table
from piezod.errors import DeviceUnavailableError
from piezod_drivers.serial_line.piezo_board.driver import make_device
from piezod_drivers.serial_line.piezo_board.emulation.build import build, sources
from piezod_drivers.serial_line.piezo_board.emulator import BoardEmulator
from piezod_drivers.serial_line.piezo_board.options import BoardOptions
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine

US = 1000


def made(target: str, out: Path, folder: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Run a target of the Makefile of piezod's firmware, or of a copy."""
    command = ["make", "-s", "-C", str(folder or sources()), target, f"OUT={out}"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def copied(tmp_path: Path, name: str, right: str, wrong: str) -> Path:
    """Return a copy of the firmware with another text in a file."""
    folder = tmp_path / "player"
    shutil.copytree(sources(), folder)
    text = (folder / name).read_text(encoding="utf-8")
    assert text.count(right) == 1
    (folder / name).write_text(text.replace(right, wrong), encoding="utf-8")
    return folder


@pytest.mark.skipif(not (shutil.which("cc") and shutil.which("make")), reason="no C compiler")
def test_facts_of_the_core_hold(tmp_path: Path) -> None:
    """The tests of the core pass, with sanitizers for addresses and undefined behaviour."""
    done = made("test", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.stress
@pytest.mark.skipif(not shutil.which("cppcheck"), reason="cppcheck is missing")
def test_analysers_find_nothing(tmp_path: Path) -> None:
    """Neither gcc -fanalyzer nor cppcheck has anything to say; they do about a mistake."""
    done = made("analyse", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    folder = copied(
        tmp_path, "core/text.c", "    return at[4] == 0;", "    at = 0;\n    return *at;"
    )
    done = made("analyse", tmp_path, folder)
    assert "analyzer-null-dereference" in done.stderr


@needs_board
def test_crashed_firmware_is_told(tmp_path: Path) -> None:
    """A firmware that runs no more ends the emulated board with an error."""
    stops = "    start();\n    cli();\n    sleep_cpu();\n"
    folder = copied(tmp_path, "avr/port.c", "    start();\n", stops)
    shared, _, time = bench()
    board = BoardEmulator(shared, "", build(folder))
    time.t_ns += MS
    with pytest.raises(DeviceUnavailableError, match="firmware"):
        board.due()


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
    assert board.processor.seen.bad_frames == 0
    record = device.recording()
    assert record.positions.shape == (60, 2)
    # A sample shows the point before: the displacement is 0.2 µm/V, the input 8 µm/V from -5 µm.
    shown = (wave[:-1] * 30.0 * 0.2 + 5.0) / 8.0
    assert record.positions[1:20] == pytest.approx(shown, abs=1e-3)
