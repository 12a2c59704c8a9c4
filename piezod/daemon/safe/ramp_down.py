"""Brings a stage to its safe voltage when there is no loop to do it; imports no numpy.

Each amplifier goes its own way: one that fails leaves the others to their ramps.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import nan
from typing import NamedTuple

from piezod.config.daemon import DaemonConfig
from piezod.daemon.clock import Clock
from piezod.daemon.safe.ramp import STEP_S, AmplifierRamp, AxisOutcome
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity
from piezod.devices.wiring import construct, pairs_of
from piezod.units import s_to_ns


class Noted(NamedTuple):
    """What the loop left on record.

    Attributes:
        drive_v: Voltage written last on each axis, in V, where that is known.
        identities: Who each device said it is when the loop opened it, where that is known.
    """

    drive_v: Mapping[str, float]
    identities: Mapping[str, Identity]


def ramp_down(
    config: DaemonConfig, noted: Noted, wait_s: float, clock: Clock
) -> dict[str, AxisOutcome]:
    """Ramp every axis of a stage from the voltage in force to its safe voltage.

    Args:
        config: The stage.
        noted: What the loop left on record.
        wait_s: For how long an amplifier may be unavailable.
        clock: Paces the steps.

    Returns:
        What became of each axis; a device's fault is among it, and no exception.

    Raises:
        DeviceError: If a device that drives an axis is no amplifier.
        RegistryError: If a driver cannot be loaded.
    """
    amplifiers = list(dict.fromkeys(axis.amplifier.device for axis in config.axes.values()))
    outcomes: dict[str, AxisOutcome] = {}
    with _ramps(config, amplifiers, noted, wait_s) as ramps:
        while not all(ramp.done for ramp in ramps):
            for ramp in ramps:
                if not ramp.done:
                    ramp.step(clock.now_ns())
            # From now on, and not from the last step on: what is late is not made up for.
            clock.sleep_until_ns(clock.now_ns() + s_to_ns(STEP_S))
        for amplifier, ramp in zip(amplifiers, ramps, strict=True):
            outcomes.update(zip(_driven(config, amplifier), ramp.outcomes(), strict=True))
    return {axis: outcomes[axis] for axis in config.axes}


@contextmanager
def _ramps(
    config: DaemonConfig,
    amplifiers: list[str],
    noted: Noted,
    wait_s: float,
) -> Iterator[list[AmplifierRamp]]:
    ramps = []
    try:
        for name in amplifiers:
            driven = _driven(config, name)
            noted_v = [noted.drive_v.get(axis, nan) for axis in driven]
            axes = [config.axes[axis] for axis in driven]
            channels, who = _channels(config, name, driven), noted.identities.get(name)
            ramps.append(AmplifierRamp(channels, axes, noted_v, wait_s, who))
        yield ramps
    finally:
        for ramp in ramps:
            ramp.close()


def _driven(config: DaemonConfig, amplifier: str) -> list[str]:
    return [name for name, axis in config.axes.items() if axis.amplifier.device == amplifier]


def _channels(config: DaemonConfig, amplifier: str, driven: list[str]) -> Channels:
    """Construct an amplifier as the loop would; what measures is left out."""
    pairs = pairs_of(config.axes)
    made = construct({amplifier: config.devices[amplifier]}, pairs, config.seed)
    return Channels(made, {axis: pairs[axis]._replace(sensor="", command=None) for axis in driven})
