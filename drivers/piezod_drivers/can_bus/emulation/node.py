"""A node on an emulated CAN bus."""

from typing import Protocol

from piezod_drivers.can_bus.frame import Frame


class Node(Protocol):
    """An emulated device; never blocks, looks at no clock but its bench's."""

    def receive(self, frame: Frame) -> list[Frame]:
        """Take a frame of the bus; return what is answered. Raises nothing, whatever it is."""
        ...

    def due(self) -> list[Frame]:
        """Return what the node sends unasked by now; called every few milliseconds."""
        ...

    def foreign(self) -> Frame:
        """Return a frame as only the host should send it, for a fault of that kind."""
        ...
