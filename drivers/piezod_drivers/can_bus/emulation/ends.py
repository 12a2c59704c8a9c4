"""Connects an emulated node to a bus."""

from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol

from piezod.devices.bus.line import LineFault
from piezod.devices.emulation.far_end import End
from piezod.devices.emulation.places import make_own_folder
from piezod.devices.emulation.pty_end import PtyEnd
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.library_bus import SOCKETCAN, LibraryBus
from piezod_drivers.can_bus.slcan_codec import (
    BEL,
    BIT_RATES,
    CLOSE,
    CR,
    OPEN,
    SlcanLines,
    decode,
    encode,
)

UDP: Final = "udp:"
SOCKETCAN_PREFIX: Final = f"{SOCKETCAN}:"
DEFAULT_GROUP: Final = "239.74.163.2"
DEFAULT_PORT: Final = 43_113


class BusEnd(End, Protocol):
    """A connection to a bus that can be pulled out."""

    def receive(self, within_ns: int) -> list[Frame]:
        """Return the frames that have come, as soon as there are some."""
        ...

    def send(self, frame: Frame) -> None:
        """Send a frame; it is lost if no host is connected."""
        ...

    def noise(self, data: bytes) -> None:
        """Send bytes that are no frame, if the bus can carry them."""
        ...

    def leave(self, away: bool) -> None:
        """Go off the bus or back on it; off the bus no frame passes, and sending is refused."""
        ...


class LibraryEnd:
    """Implements `BusEnd` by a bus of python-can.

    Args:
        where: "udp:GROUP:PORT", with only one of them or none for the default ones: a multicast
            group that does not leave this machine. Or "socketcan:CHANNEL": an interface of the
            kernel.

    Raises:
        DeviceUnavailableError: If `where` is invalid.
    """

    def __init__(self, where: str) -> None:
        kind, _, channel = where.partition(":")
        if f"{kind}:" == SOCKETCAN_PREFIX:
            if not channel:
                raise DeviceUnavailableError(
                    f"{where!r} names no interface, expected socketcan:can1"
                )
            self._place, self._bus = where, LibraryBus(SOCKETCAN, channel, {})
        else:
            group, port = _group(channel)
            settings = {"port": port, "hop_limit": 0, "fd": False}
            self._place = f"{UDP}{group}:{port}"
            self._bus = LibraryBus("udp_multicast", group, settings)
        self._away = False

    def place(self) -> str:
        """What `where` was, in full."""
        return self._place

    def appear(self) -> None:
        """Join the bus."""
        self._bus.open(())

    def vanish(self) -> None:
        """Leave the bus."""
        self._bus.close()

    def receive(self, within_ns: int) -> list[Frame]:
        """Return the next frame."""
        try:
            frame = self._bus.receive(within_ns)
        # After `vanish` the bus is not open.
        except LineFault:
            return []
        return [] if frame is None or self._away else [frame]

    def send(self, frame: Frame) -> None:
        """Send a frame to the bus."""
        if not self._away:
            with suppress(LineFault):  # the frame is lost, and the host's request times out
                self._bus.send(frame)

    def noise(self, data: bytes) -> None:
        """Send nothing: the library carries only frames."""

    def leave(self, away: bool) -> None:
        """Go off the bus, or back on it."""
        self._away = away


class Adapter:
    """An slcan adapter with the replies of LAWICEL's.

    It answers CR to a command, `z` or `Z` and CR to a frame, and BEL to a command or frame that it
    refuses. Frames need an open channel.

    Args:
        off_bus: Whether its controller has left the bus; then frames are refused.
    """

    def __init__(self, *, off_bus: bool = False) -> None:
        self._lines = SlcanLines()
        self._open = False
        self.off_bus = off_bus

    def take(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Process bytes of the host; return the frames for the bus and the reply to the host."""
        frames: list[Frame] = []
        answers = b""
        for line in self._lines.feed(data):
            frame = decode(line)
            if frame is None:
                answers += self._run_command(line)
            elif self.off_bus or not self._open:
                answers += BEL
            else:
                frames.append(frame)
                answers += (b"Z" if frame.extended else b"z") + CR
        return frames, answers

    def give(self, frame: Frame) -> bytes:
        """Return the bytes that pass a frame of the bus to the host."""
        return encode(frame) if self._open and not self.off_bus else b""

    def _run_command(self, line: bytes) -> bytes:
        # Like the CAN232: opening an open channel, closing a closed one, and changing the bit rate
        # of an open one is refused. An empty line is acknowledged, so a host can flush a half
        # command.
        was_open = self._open
        if line + CR in {OPEN, CLOSE}:
            self._open = line + CR == OPEN
            refused = self._open == was_open
        else:
            refused = was_open if line + CR in BIT_RATES.values() else line != b""
        return BEL if refused else CR


class AdapterEnd:
    """Implements `BusEnd` as an slcan adapter at a pty, with the node behind it.

    Args:
        path: Where the link to the pty is created.
    """

    def __init__(self, path: Path) -> None:
        self._end = PtyEnd(path)
        self._adapter = Adapter()

    def place(self) -> str:
        """Path of the link."""
        return self._end.place()

    def appear(self) -> None:
        """Create the pty."""
        self._end.appear()

    def vanish(self) -> None:
        """Remove the pty."""
        self._end.vanish()
        # A new adapter has its channel closed, but the state of the bus does not depend on the
        # plug.
        self._adapter = Adapter(off_bus=self._adapter.off_bus)

    def receive(self, within_ns: int) -> list[Frame]:
        """Run the commands of the host; return the frames for the bus."""
        frames, answers = self._adapter.take(self._end.receive(within_ns))
        if answers:
            self._end.send(answers)
        return frames

    def send(self, frame: Frame) -> None:
        """Pass a frame of the bus to the host."""
        if data := self._adapter.give(frame):
            self._end.send(data)

    def noise(self, data: bytes) -> None:
        """Send bytes to the host."""
        self._end.send(data)

    def leave(self, away: bool) -> None:
        """Go off the bus, or back on it."""
        self._adapter.off_bus = away


def end_at(where: str, name: str) -> BusEnd:
    """Construct the connection of a node to a bus.

    Args:
        where: "udp:GROUP:PORT", "socketcan:CHANNEL", or the path of an slcan adapter's port, or ""
            for a path in the user's own folder.
        name: Name of the profile, for the path in the user's own folder.

    Raises:
        DeviceUnavailableError: If `where` is invalid, or the folder belongs to another user.
    """
    if where.startswith((UDP, SOCKETCAN_PREFIX)):
        return LibraryEnd(where)
    return AdapterEnd(Path(where) if where else make_own_folder() / f"{name}.tty")


def _group(where: str) -> tuple[str, int]:
    """Return group and port of "GROUP:PORT", of only one of them, or of ""."""
    group, _, port = where.rpartition(":") if ":" in where else (where, "", "")
    try:
        return group or DEFAULT_GROUP, int(port or DEFAULT_PORT)
    except ValueError as error:
        what = f"{where!r} is no group, expected GROUP:PORT, {DEFAULT_GROUP}:{DEFAULT_PORT}"
        raise DeviceUnavailableError(what) from error
