"""The notes of commands that drive a stage without its loop, in the files of the loop.

Whoever drives a stage next reads there which voltages were written last, and to which devices: the
loop, `piezod safe`, or another command.
"""

import time
from collections.abc import Mapping
from math import nan

from piezod.config.daemon import DaemonConfig
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.daemon.paths import StagePaths
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity, is_same


def unconcerned(
    config: DaemonConfig, channels: Channels, known: Mapping[str, Identity]
) -> list[str]:
    """Return the axes whose noted voltage says nothing about their output.

    It was written to another amplifier, or the amplifier begins at rest whenever it is opened.

    Args:
        config: The configuration of the stage.
        channels: Open devices of the stage.
        known: The noted identities.
    """
    begins_at_rest, found = channels.capabilities().opens_relaxed, channels.identities
    return [
        axis
        for axis, one in config.axes.items()
        if (name := one.amplifier.device) in found
        and (begins_at_rest or not is_same(found[name], known.get(name, found[name])))
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

    def meet(self, channels: Channels) -> None:
        """Note the identities of open devices, and forget what does not concern their outputs.

        Args:
            channels: The devices.

        Raises:
            OSError: If the identities cannot be stored.
        """
        for axis in unconcerned(self._config, channels, self._identities):
            self._last_v[axis] = nan
            self._writer.forget(time.monotonic_ns(), list(self._config.axes).index(axis))
        self._identities |= channels.identities
        note_identities(self._paths.identities, self._identities)

    def last_v(self, axis: str) -> float:
        """Return the voltage that was written last on an axis, in V; NaN if it is not known."""
        return self._last_v[axis]

    def note(self, axis: str, drive_v: float) -> None:
        """Store a voltage that is about to be written or was found in force, in V."""
        self._last_v[axis] = drive_v
        self._writer.note([*self._last_v.values()], time.monotonic_ns())
