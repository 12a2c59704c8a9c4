"""The stage that scans are played on, as the procedures see it."""

from collections.abc import Iterator
from typing import Protocol

from piezod.devices.player import SeenEdge
from piezod.devices.scan_table import ScanTable
from piezod.experiment.scan.pixels import SweepSamples


class ScanStage(Protocol):
    """A stage that plays scans; a virtual or a running one."""

    @property
    def edges(self) -> tuple[SeenEdge, ...]:
        """The edges that the last scan has seen, in their order."""
        ...

    def rest(self) -> None:
        """Bring all axes to rest.

        Raises:
            PiezodError: If that failed.
        """
        ...

    def scan(self, table: ScanTable) -> Iterator[SweepSamples]:
        """Play a scan; yield the samples of each sweep, relative to the zeros of the sensors.

        Raises:
            DataError: If the guard refuses the table, or an edge has not come.
            DeviceError: If the device refuses it, fails, or its record could not be read.
        """
        ...


__all__ = ["ScanStage", "ScanTable", "SeenEdge"]
