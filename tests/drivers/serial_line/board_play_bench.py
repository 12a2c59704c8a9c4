"""A player board, its compiled firmware in simavr, and its driver in one process; virtual time."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest

from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.piezo_board.driver import make_device
from piezod_drivers.serial_line.piezo_board.emulation.build import build, missing
from piezod_drivers.serial_line.piezo_board.emulator import V_PER_CODE, BoardEmulator
from piezod_drivers.serial_line.piezo_board.options import BoardOptions
from tests.drivers.play_bench import PlayBench, Scale
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

needs_board: Final = pytest.mark.skipif(bool(missing()), reason=missing() or "nothing is missing")
SCALE: Final = Scale(0.0, 2.0, 1.0, lambda value: 30.0 * value, 50_000, 1e-4)
sine = SCALE.sine


@dataclass
class BoardBench(PlayBench):
    """A board, active, with everything at its other end."""

    @property
    def board(self) -> BoardEmulator:
        """The emulated board."""
        assert isinstance(self.emulator, BoardEmulator)
        return self.emulator

    @property
    def driven_codes(self) -> list[int]:
        """Every code of the first output, in order, without repetitions."""
        return [round(row[0] / V_PER_CODE) for row in self.rig.driven_v]


def play_bench(
    options: dict[str, object] | None = None,
    defines: str = "",
    folder: Path | None = None,
    wiring: Wiring | None = None,
) -> BoardBench:
    """Return an active device.

    Args:
        options: Options of the driver.
        defines: Options of the compiler of the firmware.
        folder: Folder of another firmware.
        wiring: The channels in use; None for the first one.
    """
    wiring = wiring or Wiring.both(("1",))
    channels = len(wiring.outputs)
    shared, rig, time = bench(channels)
    defines += f" -DPORT_CHANNELS={channels}"
    emulator = BoardEmulator(shared, "", build(folder, defines.strip()))
    line = EmulatedLine(emulator, time)
    configured = BoardOptions.model_validate(
        {"port": "p", "timeout_ms": 50.0, "channels": channels, **(options or {})}
    )

    def connect(wiring: Wiring) -> ExchangingPlayingBusDevice:
        device = make_device(line, configured, wiring)
        assert isinstance(device, ExchangingPlayingBusDevice)
        return device

    opened = BoardBench(connect(wiring), line, rig, time, emulator, SCALE, connect, wiring)
    opened.opened()
    return opened
