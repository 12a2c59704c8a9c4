"""An emulated amplifier and sensor on a CAN bus: what `piezod emulate can-dbc-demo` serves.

No such device exists. Its frames are those of config/devices/can-dbc-demo.dbc, with what real ones
have: counters, checksums, both orders of bytes, an answer to a request and a report now and then.
"""

from math import isnan
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.can_bus.dbc.codec import DbcMessage, DbcSignal, SignalReader
from piezod_drivers.can_bus.dbc.messages import Checksum, Received, Sent
from piezod_drivers.can_bus.emulation.host import serving
from piezod_drivers.can_bus.frame import Frame

_REPORT_NS: Final = 5_000_000
_COUNTER: Final = DbcSignal("Counter", 48, 8)
_CRC: Final = DbcSignal("Crc", 56, 8)
_POSITION: Final = DbcSignal("Position", 7, 16, True, True, 0.001)
_MEASURED: Final = DbcSignal("DriveMeasured", 16, 16, False, True, 0.005)
_NOT_SENSED: Final = -32.768
"""The position that stands for none: the sensor is at its end."""


def _message(name: str, identifier: int, n_bytes: int, *signals: DbcSignal) -> DbcMessage:
    return DbcMessage(name, identifier, n_bytes, False, {signal.name: signal for signal in signals})


COMMAND: Final = _message(
    "Command",
    0x100,
    8,
    DbcSignal("Drive", 0, 16, False, True, 0.005),
    DbcSignal("Enable", 16, 1),
    _COUNTER,
    _CRC,
)
POLL: Final = _message("Poll", 0x101, 2, DbcSignal("Counter", 0, 8), DbcSignal("Crc", 8, 8))
STATUS: Final = _message(
    "Status",
    0x180,
    8,
    _POSITION,
    _MEASURED,
    DbcSignal("Saturated", 32, 1),
    DbcSignal("Disabled", 33, 1),
    DbcSignal("Echo", 40, 8),
    _COUNTER,
    _CRC,
)
REPORT: Final = _message("Report", 0x181, 8, _POSITION, _MEASURED, _COUNTER, _CRC)


class DemoNode:
    """Implements `Node`: the amplifier and the sensor of the bench's first axis.

    A command whose checksum is wrong is not obeyed, nor one without Enable.

    Args:
        bench: What it is connected to.
    """

    def __init__(self, bench: SharedRig) -> None:
        self._bench = bench
        self._status = Sent(STATUS, {}, "Counter", Checksum(STATUS, "Crc", "crc8_j1850"))
        self._report = Sent(REPORT, {}, "Counter", Checksum(REPORT, "Crc", "crc8_j1850"))
        for sent in (self._status, self._report):
            sent.uses("Position")
            sent.uses("DriveMeasured")
        for signal in ("Saturated", "Disabled", "Echo"):
            self._status.uses(signal)
        self._command = Received(COMMAND, None, None, Checksum(COMMAND, "Crc", "crc8_j1850"))
        self._poll = Received(POLL, None, None, Checksum(POLL, "Crc", "crc8_j1850"))
        self._drive, self._enable = SignalReader(COMMAND, "Drive"), SignalReader(COMMAND, "Enable")
        self._asked = SignalReader(POLL, "Counter")
        self._enabled = False
        self._reported_ns = 0

    def receive(self, frame: Frame) -> list[Frame]:
        """Take a frame of the bus; return what is answered."""
        try:
            if frame.id == COMMAND.id:
                self._command.require_sound(frame)
                self._obey(frame)
            elif frame.id == POLL.id:
                self._poll.require_sound(frame)
                return [self._answer(frame)]
        except LineFault:
            pass  # one that is not sound is as good as none
        return []

    def due(self) -> list[Frame]:
        """Return a report every 5 ms."""
        now_ns = self._bench.now_ns()
        if now_ns - self._reported_ns < _REPORT_NS:
            return []
        self._reported_ns = now_ns
        self._measure(self._report)
        return [self._report.next()]

    def foreign(self) -> Frame:
        """Return a command for 0 V, as only the host should send it."""
        return Frame(COMMAND.id, bytes(COMMAND.n_bytes))

    def _obey(self, frame: Frame) -> None:
        self._enabled = bool(self._enable.raw(frame.data))
        if self._enabled:
            self._bench.drive(0, self._drive.value(frame.data))

    def _answer(self, frame: Frame) -> Frame:
        saturated = self._measure(self._status)
        self._status.put("Saturated", saturated)
        self._status.put("Disabled", not self._enabled)
        self._status.put("Echo", self._asked.raw(frame.data))
        return self._status.next()

    def _measure(self, sent: Sent) -> bool:
        position_um = self._bench.position_um(0)
        sent.put("Position", _NOT_SENSED if isnan(position_um) else position_um)
        sent.put("DriveMeasured", self._bench.drive_v(0))
        return isnan(position_um)


def _make(bench: SharedRig, _serial: str) -> DemoNode:
    return DemoNode(bench)


_NAME: Final = "can-dbc-demo"
EMULATOR: Final = EmulatorPlugin(
    name=_NAME,
    summary="an amplifier and sensor whose frames a DBC file describes, behind an slcan adapter or "
    "at a UDP group",
    wire="can",
    serve=serving(_NAME, _make),
)
