"""A device that plays and its emulator in one process, in virtual time."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Final, Protocol

import numpy as np

from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.emulation.emulator import Emulator
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Progress, Table
from piezod.errors import PlayCancelledError
from piezod_drivers.serial_line.wave_arrays import FloatArray
from tests.drivers.serial_line.linear_rig import LinearRig
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime

STEP_NS: Final = 10 * MS
"""Time between two calls of `progress`."""


class Cancelling:
    """A `Check` that counts its calls, and cancels at one of them.

    Args:
        at: Number of that call, from 0; -1 for none.
    """

    def __init__(self, at: int = -1) -> None:
        self._at, self.calls = at, 0

    def __call__(self) -> None:
        if self.calls == self._at:
            raise PlayCancelledError("it was aborted")
        self.calls += 1


class Unplugged(Protocol):
    """A line of a test whose cable can be pulled."""

    unplugged: bool


@dataclass(frozen=True)
class Scale:
    """The outputs of a device."""

    rest: float  #: Value at rest.
    middle: float  #: Value around which the sine swings.
    amplitude: float  #: Amplitude of the sine.
    volts: Callable[[float], float]  #: Returns the voltage at the actuator for a value.
    interval_ns: int  #: Time between two points.
    tolerance: float  #: Largest difference between a value in force and the one that is read back.

    def sine(self, n: int = 100, cycles: int = 3, n_outputs: int = 1, n_lead_in: int = 20) -> Table:
        """Return a table: a ramp from rest to the middle, then a sine around it."""
        ramp: FloatArray = np.tile(
            np.linspace(self.rest, self.middle, n_lead_in)[:, None], n_outputs
        )
        phase = 2 * pi * np.arange(n) / n
        waves = [self.amplitude * np.sin(phase + k) for k in range(n_outputs)]
        return Table(self.interval_ns, ramp, self.middle + np.stack(waves, axis=1), cycles)


@dataclass
class PlayBench:
    """A device, active, with everything at its other end."""

    device: PlayingBusDevice  #: The device.
    line: EmulatedLine  #: Its line for requests.
    rig: LinearRig  #: The rig.
    time: TestTime  #: The clock.
    emulator: Emulator  #: The emulated device.
    scale: Scale  #: Its outputs.
    #: Returns a device of another process for the same emulator; it is not open.
    connect: Callable[[Wiring], PlayingBusDevice]
    wiring: Wiring  #: The channels in use.
    streams: tuple[Unplugged, ...] = ()  #: Its other lines.

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
        for _ in range(10_000):
            self.wait(STEP_NS)
            found = self.device.progress(self.time.t_ns)
            if found.state is not PlayState.PLAYING:
                return found
        raise AssertionError("the play does not end")

    def unplug(self, *, pulled: bool) -> None:
        """Pull all cables, or plug them in again."""
        for line in (self.line, *self.streams):
            line.unplugged = pulled

    def opened(self) -> "PlayBench":
        """Return this bench, with its device open and active."""
        self.device.open()
        self.device.activate(self.time.t_ns)
        return self


def played(table: Table) -> FloatArray:
    """Return every point of a play, in order."""
    return np.concatenate((table.lead_in, *([table.period] * table.cycles)))
