"""Finds what hosts a rig in a process of its own, by the name of the rig's driver.

An emulator is an entry point of the group `piezod.emulators` that leads to a `Host`.
"""

from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final, Protocol, cast

from piezod.devices.interface import Device
from piezod.errors import RegistryError

GROUP: Final = "piezod.emulators"


class Host(Protocol):
    """Serves a rig until the process is told to end by SIGINT or SIGTERM."""

    def __call__(
        self,
        rig: Device,
        axes: Sequence[str],
        where: Path | None,
        trace: Path | None,
        ready: Callable[[Path], None],
    ) -> None:
        """Serve; to be called in the main thread.

        Args:
            rig: The device, constructed and not open.
            axes: Names of its axes.
            where: Where clients find it, None for where they look by default.
            trace: CSV file that tells of every write that is taken, None for none.
            ready: Told where clients find it, as soon as they do.

        Raises:
            DeviceError: If the rig cannot be opened, or cannot be hosted there.
            OSError: If the trace cannot be written.
        """
        ...


def load(name: str) -> Host:
    """Import the emulator for the rigs of one driver.

    Args:
        name: Name of the driver.

    Raises:
        RegistryError: If there is none.
    """
    for point in entry_points(group=GROUP, name=name):
        return cast("Host", point.load())
    known = ", ".join(sorted({point.name for point in entry_points(group=GROUP)}))
    raise RegistryError(f"nothing hosts rigs of driver {name!r}, known: {known or 'none'}")
