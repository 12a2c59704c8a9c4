"""Plays a sine on a device until it is killed; prints a line when it plays.

Arguments: driver, its options as JSON, output.
"""

import json
import sys
import time

import numpy as np

from piezod.devices import registry
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Table

N_POINTS = 100
SHORTEST_NS = 50_000
MOST_CYCLES = 50_000
SETTLING = 5
"""Cycles of a play before the stage moves periodically."""


def make(driver: str, options: dict[str, object], wiring: Wiring) -> PlayingBusDevice:
    """Return an open and active device."""
    plugin = registry.load(driver)
    device = plugin.create(plugin.options_model.model_validate(options), wiring, 1)
    assert isinstance(device, PlayingBusDevice)
    device.open()
    device.activate(time.monotonic_ns())
    return device


def sine(device: PlayingBusDevice, cycles: int, n_lead_in: int) -> Table:
    """Return a table: a ramp to the middle of the output's range, then a sine around it."""
    (_, high) = device.capabilities().ranges[0]
    wave = high * (0.5 + 0.22 * np.sin(2 * np.pi * np.arange(N_POINTS) / N_POINTS))
    ramp = np.linspace(device.read_back(0)[0], wave[0], n_lead_in, endpoint=False)
    interval_ns = device.player_capabilities().legal_interval_ns(SHORTEST_NS)
    return Table(interval_ns, ramp[:, None], wave[:, None], cycles)


def long_sine(device: PlayingBusDevice) -> Table:
    """Return a table without a lead-in that does not end within a test."""
    # A device that repeats its whole table has a memory for some cycles.
    endless = not device.player_capabilities().cycles
    return sine(device, 100 if endless else MOST_CYCLES, 0)


def start(device: PlayingBusDevice, table: Table) -> Table:
    """Load and start a table; return it as it is played."""
    loaded = device.load(table)
    device.arm()
    device.start(time.monotonic_ns())
    return loaded


def main() -> None:
    """Play until this process is killed."""
    driver, options, output = sys.argv[1:]
    device = make(driver, json.loads(options), Wiring((), (output,)))
    start(device, long_sine(device))
    assert device.progress(time.monotonic_ns()).state is PlayState.PLAYING
    print("playing", flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
