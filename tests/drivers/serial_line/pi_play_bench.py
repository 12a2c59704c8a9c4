"""A PI controller and its player in one process, in virtual time."""

from dataclasses import dataclass
from math import pi

import numpy as np

from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Progress, Table
from piezod_drivers.serial_line.pi_gcs2.driver import make_device
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from piezod_drivers.serial_line.wave_arrays import FloatArray, first_points, n_points_of
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.pi_gcs2_bench import OPTIONS
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime


@dataclass
class PlayBench:
    """A device, active, with everything at its other end."""

    device: ExchangingPlayingBusDevice
    line: EmulatedLine
    rig: LinearRig
    time: TestTime
    emulator: Gcs2Emulator

    def start(self, table: Table) -> Table:
        """Load a table and start it; return it as it is played."""
        loaded = self.device.load(table)
        self.device.arm()
        self.device.start(self.time.t_ns)
        return loaded

    def wait(self, for_ns: int) -> None:
        """Let time pass without requests."""
        self.time.t_ns += for_ns
        self.emulator.due()

    def progress_to_end(self) -> Progress:
        """Ask for the progress until the play has ended or failed."""
        for _ in range(2000):
            self.wait(10 * MS)
            found = self.device.progress(self.time.t_ns)
            if found.state is not PlayState.PLAYING:
                return found
        raise AssertionError("the play does not end")

    def another_device(self) -> ExchangingPlayingBusDevice:
        """Return a device of another process for the same controller; it is not open."""
        device = make_device(self.line, OPTIONS, Wiring((), ("1",)))
        assert isinstance(device, ExchangingPlayingBusDevice)
        return device


def play_bench(n_axes: int = 1, **options: object) -> PlayBench:
    """Return an active device."""
    table, rig, time = bench(n_axes)
    emulator = Gcs2Emulator(table, "")
    line = EmulatedLine(emulator, time)
    wiring = Wiring.both(str(i + 1) for i in range(n_axes))
    device = make_device(line, OPTIONS.model_copy(update=options), wiring)
    assert isinstance(device, ExchangingPlayingBusDevice)
    device.open()
    device.activate(time.t_ns)
    return PlayBench(device, line, rig, time, emulator)


def sine(n: int = 100, cycles: int = 3, n_outputs: int = 1, n_lead_in: int = 20) -> Table:
    """Return a table: a ramp from 0 V to 60 V, then a sine of 30 V around 60 V."""
    ramp: FloatArray = np.tile(np.linspace(0.0, 60.0, n_lead_in)[:, None], n_outputs)
    phase = 2 * pi * np.arange(n) / n
    period = 60.0 + np.stack([30 * np.sin(phase + k) for k in range(n_outputs)], axis=1)
    return Table(50_000, ramp, period, cycles)


def played(table: Table) -> FloatArray:
    """Return every point of a play, in order."""
    return first_points(table, n_points_of(table))
