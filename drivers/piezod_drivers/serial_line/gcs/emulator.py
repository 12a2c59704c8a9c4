"""A PI controller's end of the wire, of either generation."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final, NamedTuple, Protocol

from piezod.devices.emulation.bench import SharedRig

_LONGEST: Final = 256
_STOP: Final = 0x18
_IS_MOVING: Final = 0x05
_IS_READY: Final = 0x07
_READY: Final = b"\xb1\n"

_NUMBER: Final = re.compile(r"[+-]?[0-9]{1,12}(\.[0-9]{0,12})?([eE][+-]?[0-9]{1,2})?")

_Handler = Callable[[str], bytes]


class GcsRefusal(Exception):  # noqa: N818 - an answer of the protocol, not an error of ours
    """Raised where a command is not carried out.

    Args:
        code: What `ERR?` tells then.
    """

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class ProtocolQuirks(Protocol):
    """How a generation reads arguments and writes replies."""

    def ids(self, text: str, every: Sequence[str]) -> Sequence[str]:
        """Return the identifiers in the arguments of a query; all there are where none is given.

        Raises:
            GcsRefusal: If it cannot be read.
        """
        ...

    def pairs(self, text: str) -> Sequence[tuple[str, str]]:
        """Return the identifiers and values in the arguments of a setting.

        Raises:
            GcsRefusal: If it cannot be read.
        """
        ...

    def reply(self, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return the reply to a query."""
        ...

    def listed(self, ids: Sequence[str]) -> bytes:
        """Return the reply to `SAI?`."""
        ...


class GcsKind(NamedTuple):
    """What differs between controllers.

    Attributes:
        identity: Reply to `*IDN?`, with a place for the serial number.
        ids: Identifiers of the axes, in order; as many as the bench has are used.
        serial: Its usual serial number.
        number: Format of a measured value.
        servo_error: What `SVA` with the servo on gives.
        lowest_v: Lowest voltage that it drives.
        highest_v: Highest voltage that it drives.
    """

    identity: str
    ids: Sequence[str]
    serial: str
    number: str
    servo_error: int
    lowest_v: float
    highest_v: float


@dataclass
class GcsAxis:
    """State of an axis; it drives while it is online."""

    servo: bool = False
    online: bool = True
    wanted_v: float = 0.0


class GcsEmulator:
    """Implements `Emulator`: the commands that open-loop drive needs.

    A set command has no reply, nor has a query that it does not understand; `ERR?` tells the last
    error and clears it. With the servo on an axis stays where it is: there is no closed loop.

    Args:
        bench: What it is connected to.
        manners: Of its generation.
        kind: Which controller it is.
        serial: Its serial number, "" for its usual one.
    """

    def __init__(
        self, bench: SharedRig, manners: ProtocolQuirks, kind: GcsKind, serial: str
    ) -> None:
        self._bench, self._manners, self._kind = bench, manners, kind
        self._serial = serial or kind.serial
        self._ids = tuple(kind.ids[: bench.n_axes])
        self.axes = [GcsAxis(wanted_v=bench.drive_v(i)) for i in range(len(self._ids))]
        self._error = 0
        self._line = b""
        self._handlers: dict[str, _Handler] = {
            "*IDN?": lambda _: f"{kind.identity.format(serial=self._serial)}\n".encode("cp1252"),
            "ERR?": self._tell_error,
            "SAI?": lambda _: manners.listed(self._ids),
            "POS?": self._query(self._position),
            "VOL?": self._query(bench.drive_v),
            "SVA?": self._query(lambda i: self.axes[i].wanted_v),
            "SVO?": self._query(lambda i: self.axes[i].servo),
            "SVA": self._set_voltages,
            "SVO": self._set_servos,
        }

    def receive(self, data: bytes) -> list[bytes]:
        """Take what has come from the host; return the replies."""
        replies = []
        for chunk in re.split(rb"([\n\x05\x07\x18])", data):
            if chunk == b"\n":
                line, self._line = self._line, b""
                replies.append(self._obey(line))
            elif chunk and chunk[0] in {_STOP, _IS_MOVING, _IS_READY}:
                replies.append(self._at_once(chunk[0]))
            else:
                self._line = (self._line + chunk)[: _LONGEST + 1]
        return [reply for reply in replies if reply]

    def connected(self) -> None:
        """Forget the part of a line that came over a connection that is gone."""
        self._line = b""

    def due(self) -> list[bytes]:
        """Return nothing: a controller speaks when it is asked."""
        return []

    def _obey(self, line: bytes) -> bytes:
        if len(line) > _LONGEST:
            self._error = 3
            return b""
        command, _, arguments = line.decode("cp1252", "replace").strip().partition(" ")
        if not command:
            return b""
        try:
            return self._handlers.get(command.upper(), _unknown)(arguments.strip())
        except GcsRefusal as refusal:
            self._error = refusal.code
            return b""

    def _at_once(self, byte: int) -> bytes:
        if byte == _STOP:
            self._error = 10
            return b""
        return _READY if byte == _IS_READY else b"0\n"

    def _tell_error(self, _arguments: str) -> bytes:
        error, self._error = self._error, 0
        return f"{error}\n".encode()

    def _query(self, value_of: Callable[[int], float]) -> _Handler:
        def answer(arguments: str) -> bytes:
            ids = self._manners.ids(arguments, self._ids)
            values = [self._text(value_of(self._index(axis))) for axis in ids]
            return self._manners.reply(ids, values)

        return answer

    def _text(self, value: float) -> str:
        return str(int(value)) if isinstance(value, bool) else self._kind.number.format(value)

    def _position(self, axis: int) -> float:
        position_um = self._bench.position_um(axis)
        if not isfinite(position_um):
            raise GcsRefusal(505)
        return position_um

    def _set_voltages(self, arguments: str) -> bytes:
        wanted = [
            (self._index(axis), number_in(text)) for axis, text in self._manners.pairs(arguments)
        ]
        for i, value_v in wanted:
            if self.axes[i].servo:
                raise GcsRefusal(self._kind.servo_error)
            if not self._kind.lowest_v <= value_v <= self._kind.highest_v:
                raise GcsRefusal(17)
        for i, value_v in wanted:
            self.axes[i].wanted_v = value_v
            self._drive(i)
        return b""

    def _set_servos(self, arguments: str) -> bytes:
        for axis, text in self._manners.pairs(arguments):
            self.axes[self._index(axis)].servo = switch_in(text)
        return b""

    def _drive(self, i: int) -> None:
        """Drive an axis to what is wanted of it, unless something else drives it.

        Raises:
            GcsRefusal: If the amplifier cannot.
        """
        if self.axes[i].online and not self._bench.drive(i, self.axes[i].wanted_v):
            raise GcsRefusal(302)

    def _index(self, axis: str) -> int:
        if axis not in self._ids:
            raise GcsRefusal(15)
        return self._ids.index(axis)


def _unknown(_arguments: str) -> bytes:
    raise GcsRefusal(2)


def number_in(text: str) -> float:
    """Return the number in an argument.

    Raises:
        GcsRefusal: If there is none.
    """
    if not _NUMBER.fullmatch(text):
        raise GcsRefusal(25)
    return float(text)


def switch_in(text: str) -> bool:
    """Return the 0 or 1 in an argument.

    Raises:
        GcsRefusal: If there is something else.
    """
    if text not in {"0", "1"}:
        raise GcsRefusal(17)
    return text == "1"
