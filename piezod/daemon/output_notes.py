"""The notes of commands that drive a stage without its loop, in the files of the loop.

Whoever drives a stage next reads there which voltages were written last, and to which devices: the
loop, `piezod safe`, or another command.
"""

import time
from collections.abc import Iterable, Mapping
from math import isnan, nan

from piezod.config.daemon import DaemonConfig
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.daemon.paths import StagePaths
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Identity, is_same


def rests_by_itself(able: Capabilities) -> bool:
    """Return whether an amplifier goes to rest after it was closed, or may do so."""
    return not able.holds or able.watchdog


def outdated(able: Capabilities, *, clean: bool) -> bool:
    """Return whether the noted voltages of an amplifier say nothing about its outputs.

    Args:
        able: Its capabilities.
        clean: Whether the process that wrote them ended in order, and so has closed it.
    """
    return able.opens_relaxed or (clean and rests_by_itself(able))


def unconcerned(
    config: DaemonConfig, channels: Channels, known: Mapping[str, Identity], *, clean: bool
) -> list[str]:
    """Return the axes whose noted voltage says nothing about their output.

    It was written to another amplifier, or the amplifier has gone to rest by itself since.

    Args:
        config: The configuration of the stage.
        channels: Open devices of the stage.
        known: The noted identities.
        clean: Whether the process that wrote last ended in order.
    """
    found = channels.identities
    return [
        axis
        for axis, one in config.axes.items()
        if (name := one.amplifier.device) in found
        and (
            outdated(channels.devices[name].capabilities(), clean=clean)
            or not is_same(found[name], known.get(name, found[name]))
        )
    ]


class OutputNotes:
    """The last written voltage of each axis, and the identities of the devices.

    Args:
        config: The configuration of the stage.
        paths: The files of the stage; its folders exist, and the caller owns its devices.

    Raises:
        OSError: If a file cannot be made or read.
    """

    def __init__(self, config: DaemonConfig, paths: StagePaths) -> None:
        self._config, self._paths = config, paths
        self._writer = LastOutputWriter(paths.output_map, len(config.axes))
        self._last_v = dict(zip(config.axes, self._writer.kept_v, strict=True))
        self._identities = noted_identities(paths.identities)
        self._resting = list[str]()  # axes whose open devices go to rest when they are closed
        self._noted = set[str]()  # axes of which a voltage was noted here

    def meet(self, channels: Channels) -> None:
        """Note the identities of open devices, and forget what does not concern their outputs.

        Raises:
            OSError: If the identities cannot be stored.
        """
        clean = not self._paths.running.exists()
        self._forget(unconcerned(self._config, channels, self._identities, clean=clean))
        self._identities |= channels.identities
        note_identities(self._paths.identities, self._identities)
        self._resting = [
            axis
            for axis, one in self._config.axes.items()
            if (name := one.amplifier.device) in channels.identities
            and rests_by_itself(channels.devices[name].capabilities())
        ]

    def leave(self) -> None:
        """Forget what was noted here if its devices go to rest now that they are closed."""
        self._forget(axis for axis in self._resting if axis in self._noted)

    def _forget(self, axes: Iterable[str]) -> None:
        for axis in axes:
            self._last_v[axis] = nan
            self._writer.forget(time.monotonic_ns(), list(self._config.axes).index(axis))

    def last_v(self, axis: str) -> float:
        """Return the voltage that was written last on an axis, in V; NaN if it is not known."""
        return self._last_v[axis]

    def note(self, axis: str, drive_v: float) -> None:
        """Store a voltage that is about to be written or was found in force, in V.

        NaN stores that it is not known any more.
        """
        if isnan(drive_v):
            self._forget([axis])
            return
        self._noted.add(axis)
        self._last_v[axis] = drive_v
        self._writer.note([*self._last_v.values()], time.monotonic_ns())
