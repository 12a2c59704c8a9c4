"""The emulated PI controller, of either generation."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final, NamedTuple, Protocol

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator

_STOP: Final = 0x18
_IS_MOVING: Final = 0x05
_IS_READY: Final = 0x07
_READY: Final = b"\xb1\n"

_NUMBER: Final = re.compile(r"[+-]?[0-9]{1,12}(\.[0-9]{0,12})?([eE][+-]?[0-9]{1,2})?")

_Handler = Callable[[str], bytes]


class GcsRefusal(Exception):  # noqa: N818 - a reply of the device
    """Raised if a command is refused.

    Args:
        code: Error code that `ERR?` then reports.
    """

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class ProtocolQuirks(Protocol):
    """How a generation reads arguments and writes replies."""

    def ids(self, text: str, every: Sequence[str]) -> Sequence[str]:
        """Return the identifiers in the arguments of a query; all of them if there are none.

        Raises:
            GcsRefusal: If the arguments are invalid.
        """
        ...

    def pairs(self, text: str) -> Sequence[tuple[str, str]]:
        """Return the identifiers and values in the arguments of a setting.

        Raises:
            GcsRefusal: If the arguments are invalid.
        """
        ...

    def reply(self, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return the reply to a query."""
        ...

    def axes_reply(self, ids: Sequence[str]) -> bytes:
        """Return the reply to `SAI?`."""
        ...


class GcsModel(NamedTuple):
    """Properties in which controllers differ."""

    identity: str  #: Reply to `*IDN?`, with a placeholder for the serial number.
    ids: Sequence[str]  #: Identifiers of the axes in order; the rig's number of axes is used.
    serial: str  #: Usual serial number.
    number: str  #: Format of a measured value.
    servo_error: int  #: Error code of `SVA` while the servo is on.
    lowest_v: float  #: Lowest voltage.
    highest_v: float  #: Highest voltage.
    longest: int = 256  #: Length of the longest command, in bytes.


@dataclass
class GcsAxis:
    """State of an axis; `SVA` drives it while it is online."""

    servo: bool = False
    online: bool = True
    setpoint_v: float = 0.0


class GcsEmulator(Emulator):
    """Implements `Emulator`: the commands that open-loop drive needs.

    A set command and an unknown query have no reply; `ERR?` reports the last error and clears
    it. With the servo on, an axis keeps its voltage: there is no closed loop.

    Args:
        quirks: Text format of the generation.
        serial: Serial number, "" for its usual one.
    """

    def __init__(
        self, bench: SharedRig, quirks: ProtocolQuirks, model: GcsModel, serial: str
    ) -> None:
        self._bench, self._quirks, self._model = bench, quirks, model
        self._serial = serial or model.serial
        self._ids = tuple(model.ids[: bench.n_axes])
        self.axes = [GcsAxis(setpoint_v=bench.drive_v(i)) for i in range(len(self._ids))]
        self._error = 0
        self._line = b""
        # Commands of a single byte, which need no line feed.
        self._bytes: dict[int, Callable[[], bytes]] = {
            _STOP: self._stop,
            _IS_MOVING: lambda: b"0\n",
            _IS_READY: lambda: _READY,
        }
        self._handlers: dict[str, _Handler] = {
            "*IDN?": lambda _: f"{model.identity.format(serial=self._serial)}\n".encode("cp1252"),
            "ERR?": self._report_error,
            "SAI?": lambda _: quirks.axes_reply(self._ids),
            "POS?": self._query(self._position),
            "VOL?": self._query(self._measured_v),
            "SVA?": self._query(lambda i: self.axes[i].setpoint_v),
            "SVO?": self._query(lambda i: self.axes[i].servo),
            "SVA": self._set_voltages,
            "SVO": self._set_servos,
        }

    def receive(self, data: bytes) -> list[bytes]:
        """Process bytes of the host; return the replies."""
        replies = []
        # Commands of a single byte also work inside a line, and do not end it.
        breaks = re.escape(bytes((*self._bytes, ord("\n"))))
        for chunk in re.split(b"([" + breaks + b"])", data):
            if chunk == b"\n":
                line, self._line = self._line, b""
                replies.append(self._execute(line))
            elif chunk and chunk[0] in self._bytes:
                replies.append(self._bytes[chunk[0]]())
            else:
                # One byte more than allowed is kept, so that a line that is too long is recognized.
                self._line = (self._line + chunk)[: self._model.longest + 1]
        return [reply for reply in replies if reply]

    def connected(self) -> None:
        """Discard an incomplete line of an earlier connection."""
        self._line = b""

    def _execute(self, line: bytes) -> bytes:
        if len(line) > self._model.longest:
            # 3: command too long.
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

    def _stop(self) -> bytes:
        # 10: stopped.
        self._error = 10
        return b""

    def _report_error(self, _arguments: str) -> bytes:
        error, self._error = self._error, 0
        return f"{error}\n".encode()

    def _query(self, value_of: Callable[[int], float]) -> _Handler:
        def answer(arguments: str) -> bytes:
            ids = self._quirks.ids(arguments, self._ids)
            values = [self._text(value_of(self._index(axis))) for axis in ids]
            return self._quirks.reply(ids, values)

        return answer

    def _text(self, value: float) -> str:
        return str(int(value)) if isinstance(value, bool) else self._model.number.format(value)

    def _measured_v(self, axis: int) -> float:
        return self._bench.drive_v(axis)

    def _position_um(self, axis: int) -> float:
        return self._bench.position_um(axis)

    def _position(self, axis: int) -> float:
        position_um = self._position_um(axis)
        if not isfinite(position_um):
            # 505: the sensor signal is invalid.
            raise GcsRefusal(505)
        return position_um

    def _set_voltages(self, arguments: str) -> bytes:
        # All axes are checked before one is driven: a refused command changes nothing.
        setpoints = [
            (self._index(axis), number_in(text)) for axis, text in self._quirks.pairs(arguments)
        ]
        for i, value_v in setpoints:
            if self.axes[i].servo:
                raise GcsRefusal(self._model.servo_error)
            if not self._model.lowest_v <= value_v <= self._model.highest_v:
                raise GcsRefusal(17)
        for i, value_v in setpoints:
            self.axes[i].setpoint_v = value_v
            self._drive(i)
        return b""

    def _set_servos(self, arguments: str) -> bytes:
        for axis, text in self._quirks.pairs(arguments):
            self.axes[self._index(axis)].servo = switch_in(text)
        return b""

    def _drive(self, i: int) -> None:
        """Drive an axis to its setpoint, unless it is offline.

        Raises:
            GcsRefusal: If the amplifier refuses the voltage.
        """
        if self.axes[i].online and not self._bench.drive(i, self.axes[i].setpoint_v):
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
        GcsRefusal: If it is not a number.
    """
    if not _NUMBER.fullmatch(text):
        raise GcsRefusal(25)
    return float(text)


def switch_in(text: str) -> bool:
    """Return the switch, 0 or 1, in an argument.

    Raises:
        GcsRefusal: If it is another value.
    """
    if text not in {"0", "1"}:
        raise GcsRefusal(17)
    return text == "1"
