"""An NV200/D and its player in one process, in virtual time."""

from dataclasses import dataclass
from typing import Final

from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.psj.driver import make_device
from piezod_drivers.serial_line.psj.emulation.waveforms import Waveforms
from piezod_drivers.serial_line.psj.emulator import PsjEmulator
from piezod_drivers.serial_line.psj.options import PsjOptions
from tests.drivers.play_bench import PlayBench, Scale
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

SCALE: Final = Scale(0.0, 60.0, 30.0, lambda value: value, 50_000, 1e-2)
sine = SCALE.sine


@dataclass
class Nv200Bench(PlayBench):
    """An amplifier, active, with everything at its other end."""

    @property
    def amplifier(self) -> PsjEmulator:
        """The emulated amplifier."""
        assert isinstance(self.emulator, PsjEmulator)
        return self.emulator

    @property
    def waveforms(self) -> Waveforms:
        """Its waveform generator and its recorder."""
        assert self.amplifier.waveforms is not None
        return self.amplifier.waveforms


def play_bench(*, drops: bool = False, **options: object) -> Nv200Bench:
    """Return an active device.

    Args:
        drops: Whether a waveform that has stopped goes to 0 %.
        **options: Options of the device.
    """
    table, rig, time = bench()
    emulator = PsjEmulator("nv200", table, "")
    line = EmulatedLine(emulator, time)
    chosen = PsjOptions.model_validate(
        {"profile": "nv200", "port": "p", "range_v": (-20.0, 150.0), **options}
    )

    def connect(wiring: Wiring) -> PlayingBusDevice:
        device = make_device(line, chosen, wiring)
        assert isinstance(device, PlayingBusDevice)
        return device

    wiring = Wiring.both(("ch0",))
    opened = Nv200Bench(connect(wiring), line, rig, time, emulator, SCALE, connect, wiring)
    opened.waveforms.drops = drops
    opened.opened()
    return opened
