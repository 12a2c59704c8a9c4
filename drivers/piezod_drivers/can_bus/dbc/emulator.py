"""The emulated amplifier and sensor of `piezod emulate can-dbc-demo`.

No such device exists. Its frames are those of config/devices/can-dbc-demo.dbc. They have the
features of real frames: counters, checksums, both byte orders, a reply to a request and a periodic
report.
"""

from math import isnan
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.can_bus.dbc.codec import DbcMessage, DbcSignal, SignalReader
from piezod_drivers.can_bus.dbc.messages import Checksum, ReceivedMessage, SentMessage
from piezod_drivers.can_bus.emulation.host import serving
from piezod_drivers.can_bus.frame import Frame

_REPORT_NS: Final = 5_000_000
_COUNTER: Final = DbcSignal("Counter", 48, 8)
_CRC: Final = DbcSignal("Crc", 56, 8)
_POSITION: Final = DbcSignal("Position", 7, 16, True, True, 0.001)
_MEASURED: Final = DbcSignal("DriveMeasured", 16, 16, False, True, 0.005)
# The lowest code of 16 bits: out of the range that the DBC file gives.
_NOT_SENSED: Final = -32.768
"""Position that is sent while the sensor is saturated."""


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
    """Implements `Node`: the amplifier and the sensor of the rig's first axis.

    It ignores a command with a wrong checksum, and one without Enable.
    """

    def __init__(self, bench: SharedRig) -> None:
        self._bench = bench
        self._status = SentMessage(STATUS, {}, "Counter", Checksum(STATUS, "Crc", "crc8_j1850"))
        self._report = SentMessage(REPORT, {}, "Counter", Checksum(REPORT, "Crc", "crc8_j1850"))
        for sent in (self._status, self._report):
            sent.prepare("Position")
            sent.prepare("DriveMeasured")
        for signal in ("Saturated", "Disabled", "Echo"):
            self._status.prepare(signal)
        self._command = ReceivedMessage(COMMAND, None, None, Checksum(COMMAND, "Crc", "crc8_j1850"))
        self._poll = ReceivedMessage(POLL, None, None, Checksum(POLL, "Crc", "crc8_j1850"))
        self._drive, self._enable = SignalReader(COMMAND, "Drive"), SignalReader(COMMAND, "Enable")
        self._request_counter = SignalReader(POLL, "Counter")
        self._enabled = False
        self._reported_ns = 0

    def receive(self, frame: Frame) -> list[Frame]:
        """Process a frame of the bus and return the replies."""
        try:
            if frame.id == COMMAND.id:
                self._command.require_valid(frame)
                self._execute(frame)
            elif frame.id == POLL.id:
                self._poll.require_valid(frame)
                return [self._answer(frame)]
        except LineFault:
            pass  # an invalid frame is ignored
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
        """Return a command for 0 V, which only the host should send."""
        return Frame(COMMAND.id, bytes(COMMAND.n_bytes))

    def _execute(self, frame: Frame) -> None:
        # A command without Enable keeps the voltage and reports "Disabled".
        self._enabled = bool(self._enable.raw(frame.data))
        if self._enabled:
            self._bench.drive(0, self._drive.value(frame.data))

    def _answer(self, frame: Frame) -> Frame:
        saturated = self._measure(self._status)
        self._status.put("Saturated", saturated)
        self._status.put("Disabled", not self._enabled)
        # The echo lets a host distinguish this reply from a late one.
        self._status.put("Echo", self._request_counter.raw(frame.data))
        return self._status.next()

    def _measure(self, sent: SentMessage) -> bool:
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
    "in a UDP group",
    wire="can",
    serve=serving(_NAME, _make),
)
