"""What connects an emulated node to a bus."""

from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol

from piezod.devices.bus.line import LineFault
from piezod.devices.emulation.far_end import End
from piezod.devices.emulation.places import make_own_folder
from piezod.devices.emulation.pty_end import PtyEnd
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.library_bus import LibraryBus
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
DEFAULT_GROUP: Final = "239.74.163.2"
DEFAULT_PORT: Final = 43_113


class BusEnd(End, Protocol):
    """A connection to a bus that can be pulled out."""

    def receive(self, within_ns: int) -> list[Frame]:
        """Return what has come, as soon as something has."""
        ...

    def send(self, frame: Frame) -> None:
        """Send a frame; it is lost where nobody is there."""
        ...

    def noise(self, data: bytes) -> None:
        """Send bytes that are no frame, where the bus carries such."""
        ...

    def leave(self, away: bool) -> None:
        """Be off the bus, or on it again: frames go neither way, and the host's are refused."""
        ...


class GroupEnd:
    """Implements `BusEnd` in a UDP multicast group that does not leave this machine.

    Args:
        where: GROUP:PORT, or either of them, or "".
    """

    def __init__(self, where: str) -> None:
        group, _, port = where.rpartition(":") if ":" in where else (where, "", "")
        try:
            self._group, self._port = group or DEFAULT_GROUP, int(port or DEFAULT_PORT)
        except ValueError as error:
            what = f"no group {where!r}, expected GROUP:PORT as in {DEFAULT_GROUP}:{DEFAULT_PORT}"
            raise DeviceUnavailableError(what) from error
        settings = {"port": self._port, "hop_limit": 0, "fd": False}
        self._bus = LibraryBus("udp_multicast", self._group, settings)
        self._away = False

    def place(self) -> str:
        """The group and the port."""
        return f"{UDP}{self._group}:{self._port}"

    def appear(self) -> None:
        """Join the group."""
        self._bus.open(())

    def vanish(self) -> None:
        """Leave the group."""
        self._bus.close()

    def receive(self, within_ns: int) -> list[Frame]:
        """Return the next frame."""
        try:
            frame = self._bus.receive(within_ns)
        except LineFault:
            return []
        return [] if frame is None or self._away else [frame]

    def send(self, frame: Frame) -> None:
        """Send a frame to the group."""
        if not self._away:
            with suppress(LineFault):  # nobody gets it: whoever waits for it is late
                self._bus.send(frame)

    def noise(self, data: bytes) -> None:
        """Send nothing: a packet is a frame or nothing."""

    def leave(self, away: bool) -> None:
        """Be off the bus, or on it again."""
        self._away = away


class Adapter:
    """An slcan adapter: it acknowledges as LAWICEL's does.

    That is CR for a command, `z` or `Z` and CR for a frame, BEL for what it refuses. The channel
    has to be open for frames.

    Args:
        off_bus: Whether its controller has left the bus: frames are refused.
    """

    def __init__(self, *, off_bus: bool = False) -> None:
        self._lines = SlcanLines()
        self._open = False
        self.off_bus = off_bus

    def take(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Take what the host says; return the frames that go to the bus, and what it is told."""
        frames: list[Frame] = []
        answers = b""
        for line in self._lines.feed(data):
            frame = decode(line)
            if frame is None:
                answers += self._obey(line)
            elif self.off_bus or not self._open:
                answers += BEL
            else:
                frames.append(frame)
                answers += (b"Z" if frame.extended else b"z") + CR
        return frames, answers

    def give(self, frame: Frame) -> bytes:
        """Return what the host is told of a frame of the bus."""
        return encode(frame) if self._open and not self.off_bus else b""

    def _obey(self, line: bytes) -> bytes:
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
        path: Where the link to the pty is made.
    """

    def __init__(self, path: Path) -> None:
        self._end = PtyEnd(path)
        self._adapter = Adapter()

    def place(self) -> str:
        """The path of the link."""
        return self._end.place()

    def appear(self) -> None:
        """Make the pty."""
        self._end.appear()

    def vanish(self) -> None:
        """Remove the pty."""
        self._end.vanish()
        self._adapter = Adapter(off_bus=self._adapter.off_bus)

    def receive(self, within_ns: int) -> list[Frame]:
        """Carry commands out; return the frames that are sent to the bus."""
        frames, answers = self._adapter.take(self._end.receive(within_ns))
        if answers:
            self._end.send(answers)
        return frames

    def send(self, frame: Frame) -> None:
        """Pass a frame of the bus on."""
        if said := self._adapter.give(frame):
            self._end.send(said)

    def noise(self, data: bytes) -> None:
        """Send bytes to the host."""
        self._end.send(data)

    def leave(self, away: bool) -> None:
        """Be off the bus, or on it again."""
        self._adapter.off_bus = away


def end_at(where: str, name: str) -> BusEnd:
    """Construct what connects a node to a bus.

    Args:
        where: `udp:GROUP:PORT`, or the path of an slcan adapter's port; "" for one in the user's
            own folder.
        name: Of the profile, for that.

    Raises:
        DeviceUnavailableError: If it is neither, or the folder belongs to somebody else.
    """
    if where.startswith(UDP):
        return GroupEnd(where.removeprefix(UDP))
    return AdapterEnd(Path(where) if where else make_own_folder() / f"{name}.tty")
