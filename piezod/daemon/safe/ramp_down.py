"""Brings a stage to its safe voltage if it has no loop; imports no numpy.

Each amplifier has its own ramp: one that fails does not stop the others.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import nan
from typing import NamedTuple

from piezod.config.daemon import DaemonConfig
from piezod.daemon.clock import Clock
from piezod.daemon.safe.ramp import STEP_S, AmplifierRamp, AxisOutcome, Before
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity
from piezod.devices.wiring import construct, pairs_of
from piezod.units import s_to_ns


class Noted(NamedTuple):
    """What the loop has stored."""

    drive_v: Mapping[str, float]  #: Last written voltage of each axis, in V, if known.
    identities: Mapping[
        str, Identity
    ]  #: Identity of each device when the loop opened it, if known.
    clean: bool = False  #: Whether the loop has ended in order, and so has closed its devices.


def ramp_down(
    config: DaemonConfig, noted: Noted, wait_s: float, clock: Clock, *, confirmed: bool = False
) -> dict[str, AxisOutcome]:
    """Ramp every axis of a stage from its present voltage to its safe voltage.

    Args:
        config: The configuration of the stage.
        noted: What the loop has stored.
        wait_s: How long an amplifier may be unavailable, in s.
        clock: Paces the steps.
        confirmed: Whether a person answers for the read-backs, whatever was written last.

    Returns:
        The outcome of each axis; failures of devices are outcomes, not exceptions.

    Raises:
        DeviceError: If a device that drives an axis is no amplifier.
        RegistryError: If a driver cannot be loaded.
    """
    amplifiers = _amplifiers(config)
    outcomes: dict[str, AxisOutcome] = {}
    with _ramps(config, amplifiers, noted, wait_s, confirmed=confirmed) as ramps:
        while not all(ramp.done for ramp in ramps):
            for ramp in ramps:
                if not ramp.done:
                    ramp.step(clock.now_ns())
            # Counted from now: after a late step the ramp does not become faster.
            clock.sleep_until_ns(clock.now_ns() + s_to_ns(STEP_S))
        for amplifier, ramp in zip(amplifiers, ramps, strict=True):
            outcomes.update(zip(_driven(config, amplifier), ramp.outcomes(), strict=True))
    return {axis: outcomes[axis] for axis in config.axes}


def load_drivers(config: DaemonConfig) -> None:
    """Load the drivers of all amplifiers; a later `ramp_down` needs no file of the installation.

    Raises:
        RegistryError: If a driver cannot be loaded.
    """
    for name in _amplifiers(config):
        _channels(config, name, _driven(config, name))


def _amplifiers(config: DaemonConfig) -> list[str]:
    """Return the amplifiers: one that drives several axes once, in the order of the axes."""
    return list(dict.fromkeys(axis.amplifier.device for axis in config.axes.values()))


@contextmanager
def _ramps(
    config: DaemonConfig,
    amplifiers: list[str],
    noted: Noted,
    wait_s: float,
    *,
    confirmed: bool,
) -> Iterator[list[AmplifierRamp]]:
    ramps = []
    try:
        for name in amplifiers:
            driven = _driven(config, name)
            last_v = [noted.drive_v.get(axis, nan) for axis in driven]
            axes = [config.axes[axis] for axis in driven]
            expected = noted.identities.get(name)
            before = Before(last_v, expected, config.rate_hz, noted.clean, confirmed)
            ramps.append(AmplifierRamp(_channels(config, name, driven), axes, before, wait_s))
        yield ramps
    finally:
        for ramp in ramps:
            ramp.close()


def _driven(config: DaemonConfig, amplifier: str) -> list[str]:
    return [name for name, axis in config.axes.items() if axis.amplifier.device == amplifier]


def _channels(config: DaemonConfig, amplifier: str, driven: list[str]) -> Channels:
    """Construct an amplifier as the loop does, but without its sensors."""
    pairs = pairs_of(config.axes)
    lines = {name: line for name, line in config.lines.items() if line.output}  # they go low
    made = construct({amplifier: config.devices[amplifier]}, pairs, config.seed, lines)
    own = {axis: pairs[axis]._replace(sensor="", command=None) for axis in driven}
    return Channels(made, own, lines)
