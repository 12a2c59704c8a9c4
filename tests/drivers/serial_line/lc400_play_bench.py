"""An LC.400 and its player in one process, in virtual time."""

from dataclasses import dataclass
from typing import Final

from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.npoint_lc400.driver import make_device
from piezod_drivers.serial_line.npoint_lc400.emulation.wavetables import MID_V, V_PER_PCT
from piezod_drivers.serial_line.npoint_lc400.emulator import Lc400
from piezod_drivers.serial_line.npoint_lc400.options import Lc400Options
from tests.drivers.play_bench import PlayBench, Scale
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

SCALE: Final = Scale(-50.0, -10.0, 20.0, lambda value: MID_V + V_PER_PCT * value, 48_000, 1e-3)
sine = SCALE.sine


@dataclass
class Lc400Bench(PlayBench):
    """A controller, active, with everything at its other end."""

    @property
    def controller(self) -> Lc400:
        """The emulated controller."""
        assert isinstance(self.emulator, Lc400)
        return self.emulator


def play_bench(n_axes: int = 1, *, adds: bool = True, drops: bool = True) -> Lc400Bench:
    """Return an active device.

    Args:
        n_axes: Number of channels.
        adds: Whether a wavetable adds to the command.
        drops: Whether a wavetable that has stopped counts as 0.
    """
    table, rig, time = bench(n_axes)
    emulator = Lc400(table, "")
    emulator.wavetables.adds, emulator.wavetables.drops = adds, drops
    line = EmulatedLine(emulator, time)
    options = Lc400Options(port="p")

    def connect(wiring: Wiring) -> ExchangingPlayingBusDevice:
        device = make_device(line, options, wiring)
        assert isinstance(device, ExchangingPlayingBusDevice)
        return device

    wiring = Wiring.both(str(i + 1) for i in range(n_axes))
    opened = Lc400Bench(connect(wiring), line, rig, time, emulator, SCALE, connect, wiring)
    opened.opened()
    return opened
