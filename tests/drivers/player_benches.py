"""The players that the contract of players is tested on."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Final, NamedTuple, Protocol

import numpy as np

from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import Amplifier, Wiring
from piezod.devices.player import Player, PlayState, Progress, Table
from piezod_drivers.kernel.comedi.driver import make_device
from piezod_drivers.serial_line.piezo_board.emulation.build import missing
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.drivers.kernel.fake_card import OPTIONS as CARD
from tests.drivers.kernel.fake_card import FakeCard
from tests.drivers.modbus import play_bench as modbus_bench
from tests.drivers.play_bench import PlayBench
from tests.drivers.serial_line import (
    board_play_bench,
    lc400_play_bench,
    nv200_play_bench,
    pi_play_bench,
)

_STEP_NS: Final = 10_000_000
_REPORTED_NS: Final = 500_000_000
"""A device on a bus is asked now and then; its end is reported within this time, in ns."""


class PlayingAmplifier(Player, Amplifier, Protocol):
    """A device that plays and drives."""


class OpenPlayer(NamedTuple):
    """An open and active player with one output."""

    device: PlayingAmplifier  #: The device.
    now_ns: Callable[[], int]  #: Returns the present instant, in ns.
    wait: Callable[[int], None]  #: Lets at least this time pass, in ns.
    outside: float  #: A value beyond the range of its output.
    settled: float  #: Largest difference of a read-back value and the written one, after 20 ms.

    def table(self, cycles: int = 3, lead_in: int = 20, period: int = 40) -> Table:
        """Return a table at the shortest interval: a ramp up, then a wave that ends above 0."""
        wave = 2.0 + np.sin(2.0 * np.pi * np.arange(period) / period)
        ramp = np.linspace(0.0, 2.0, lead_in, endpoint=False)
        interval_ns = self.device.player_capabilities().shortest_interval_ns
        return Table(interval_ns, ramp[:, None], wave[:, None], cycles)

    def start(self, table: Table) -> Table:
        """Load and start a table; return it as it is played."""
        loaded = self.device.load(table)
        self.device.arm()
        self.device.start(self.now_ns())
        return loaded

    def finish(self, table: Table) -> Progress:
        """Let a whole play pass; return the progress, which may be reported a little later."""
        self.wait(table.duration_ns + table.interval_ns)
        for _ in range(_REPORTED_NS // _STEP_NS):
            progress = self.device.progress(self.now_ns())
            if progress.state is not PlayState.PLAYING:
                break
            self.wait(_STEP_NS)
        return progress


@contextmanager
def simulated() -> Iterator[OpenPlayer]:
    """Open a simulated rig, in virtual time."""
    now = [1_000_000_000]

    def wait(duration_ns: int) -> None:
        now[0] += duration_ns

    rig = SimulatedRig(SimulatedOptions(), Wiring.both(("x",)), 1)
    rig.open()
    rig.activate(now[0])
    yield OpenPlayer(rig, lambda: now[0], wait, outside=200.0, settled=0.1)
    rig.close()


@contextmanager
def emulated(bench: PlayBench, outside: float) -> Iterator[OpenPlayer]:
    """Open a device that is emulated in virtual time."""
    yield OpenPlayer(bench.device, bench.time.now_ns, bench.wait, outside, settled=0.01)
    bench.device.close()


@contextmanager
def comedi() -> Iterator[OpenPlayer]:
    """Open a converter card in memory, in virtual time."""
    card = FakeCard()
    device = make_device(CARD, Wiring(("position",), ("drive",)), card)
    assert isinstance(device, PlayingBusDevice)
    device.open()
    device.activate(card.now_ns)
    yield OpenPlayer(device, lambda: card.now_ns, card.wait, outside=10.1, settled=0.001)
    device.close()


BENCHES: dict[str, Callable[[], AbstractContextManager[OpenPlayer]]] = {
    "simulated": simulated,
    "labjack-t7": lambda: emulated(modbus_bench.play_bench(), 5.1),
    "pi-gcs2": lambda: emulated(pi_play_bench.play_bench(wave_end="holds"), 151.0),
    "comedi": comedi,
    "lc400": lambda: emulated(lc400_play_bench.play_bench(), 50.1),
    "psj-nv200": lambda: emulated(nv200_play_bench.play_bench(wave_end="holds"), 151.0),
}
if not missing():
    BENCHES["board"] = lambda: emulated(board_play_bench.play_bench(), 5.1)
