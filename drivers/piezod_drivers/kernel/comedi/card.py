"""What the driver asks of an open converter card."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from piezod_drivers.kernel.comedi.codec import Converter


class Pin(NamedTuple):
    """A channel of a card, as wired."""

    subdevice: int  #: Number of the subdevice.
    number: int  #: Number of the channel.
    range: int  #: Index of the range.
    reference: int  #: Index of the reference.

    @property
    def packed(self) -> int:
        """The channel in a list of channels of a command."""
        return self.number | self.range << 16 | self.reference << 24


class Timing(NamedTuple):
    """Time between two scans, and their number."""

    interval_ns: int  #: Time between two scans, in ns.
    n_scans: int  #: Number of scans.


class Card(Protocol):
    """An open converter card.

    All methods but `open` and `close` raise `LineFault` if the kernel refuses.
    """

    def open(self) -> tuple[str, str, str]:
        """Open the card; return driver, board, and version of the kernel's comedi.

        Raises:
            DeviceUnavailableError: If it is absent, not allowed, or libcomedi is missing.
        """
        ...

    def close(self) -> None:
        """Close it; its commands are cancelled, and its outputs hold. Never raises."""
        ...

    def subdevice(self, kind: int) -> int:
        """Return the first subdevice of a kind, -1 if there is none."""
        ...

    def flags(self, subdevice: int) -> int:
        """Return the flags of a subdevice. Real-time safe."""
        ...

    def pin(self, subdevice: int, number: int, volts: tuple[float, float], reference: int) -> Pin:
        """Return a channel with the smallest range that holds these voltages.

        Raises:
            DeviceError: If the card has no such channel or range.
        """
        ...

    def line(self, number: int, subdevice: int | None, *, driven: bool) -> Pin:
        """Return a digital line.

        Args:
            number: Number of the channel.
            subdevice: Number of the subdevice; None for the first one that has such a line.
            driven: Whether it is an output.

        Raises:
            DeviceError: If the card has no such line.
        """
        ...

    def direct(self, outputs: Sequence[Pin], inputs: Sequence[Pin]) -> None:
        """Make digital lines outputs and inputs; those that are it already stay as they are.

        Raises:
            DeviceError: If a line cannot be an output beside these inputs; then it is an input.
        """
        ...

    def converter(self, pin: Pin, calibration: str | None) -> Converter:
        """Return the conversion of a channel.

        Raises:
            DeviceError: If the card is calibrated by software, and the file is missing.
        """
        ...

    def read(self, pin: Pin) -> int:
        """Return the code of a channel. Real-time safe."""
        ...

    def write(self, pin: Pin, code: int) -> None:
        """Set the code of an output. Real-time safe."""
        ...

    def lock(self, subdevice: int) -> None:
        """Keep other programs from using a subdevice."""
        ...

    def unlock(self, subdevice: int) -> None:
        """Let other programs use a subdevice. Never raises."""
        ...

    def buffer_bytes(self, subdevice: int) -> int:
        """Make the buffer of a subdevice as large as it may be; return its size."""
        ...

    def test(self, pins: list[Pin], timing: Timing) -> Timing:
        """Return the timing that the card would have if it were asked for this one."""
        ...

    def command(self, pins: list[Pin], timing: Timing) -> None:
        """Prepare to sample, or to drive, at this timing; `trigger` starts it."""
        ...

    def trigger(self, subdevice: int) -> None:
        """Start the prepared command of a subdevice."""
        ...

    def cancel(self, subdevice: int) -> None:
        """End the command of a subdevice, if there is one. Real-time safe."""
        ...

    def waiting_bytes(self, subdevice: int) -> int:
        """Return how many bytes of the buffer the card has not taken yet. Real-time safe."""
        ...

    def put(self, data: memoryview) -> int:
        """Append bytes to the buffer of the outputs; return how many fit. Real-time safe."""
        ...

    def take(self) -> bytes:
        """Return the bytes that were sampled since the last call. Real-time safe."""
        ...
