"""The interface of an emulated node on a CAN bus."""

from typing import Protocol

from piezod_drivers.can_bus.frame import Frame


class Node(Protocol):
    """An emulated device. It never blocks, and its only clock is that of the rig."""

    def receive(self, frame: Frame) -> list[Frame]:
        """Process a frame of the bus and return the replies. Never raises."""
        ...

    def due(self) -> list[Frame]:
        """Return the frames that the node sends by itself by now; called every few ms."""
        ...

    def foreign(self) -> Frame:
        """Return a frame that only the host should send, for the fault `FOREIGN`."""
        ...
