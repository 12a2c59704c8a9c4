"""A PI controller and its player in one process, in virtual time."""

from dataclasses import dataclass
from typing import Final

from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.pi_gcs2.driver import make_device
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from tests.drivers.play_bench import PlayBench, Scale
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.pi_gcs2_bench import OPTIONS
from tests.drivers.serial_line.scripted_line import EmulatedLine

SCALE: Final = Scale(0.0, 60.0, 30.0, lambda value: value, 50_000, 1e-4)
sine = SCALE.sine


@dataclass
class PiBench(PlayBench):
    """A PI controller, active, with everything at its other end."""

    @property
    def controller(self) -> Gcs2Emulator:
        """The emulated controller."""
        assert isinstance(self.emulator, Gcs2Emulator)
        return self.emulator


def play_bench(n_axes: int = 1, **options: object) -> PiBench:
    """Return an active device."""
    table, rig, time = bench(n_axes)
    emulator = Gcs2Emulator(table, "")
    line = EmulatedLine(emulator, time)

    def connect(wiring: Wiring) -> ExchangingPlayingBusDevice:
        device = make_device(line, OPTIONS.model_copy(update=options), wiring)
        assert isinstance(device, ExchangingPlayingBusDevice)
        return device

    wiring = Wiring.both(str(i + 1) for i in range(n_axes))
    opened = PiBench(connect(wiring), line, rig, time, emulator, SCALE, connect, wiring)
    opened.opened()
    return opened
