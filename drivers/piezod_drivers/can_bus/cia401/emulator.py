"""The emulated CiA 401 node of `piezod emulate canopen-401`."""

from math import isnan
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.can_bus.cia401 import objects as o
from piezod_drivers.can_bus.cia401.emulation.heartbeat_consumer import HeartbeatConsumer
from piezod_drivers.can_bus.cia401.emulation.object_dictionary import (
    N_CHANNELS,
    SERIAL,
    Entry,
    object_dictionary,
)
from piezod_drivers.can_bus.cia401.emulation.sdo_server import AbortCode, AbortError, SdoServer
from piezod_drivers.can_bus.emulation.host import serving
from piezod_drivers.can_bus.frame import Frame

NODE: Final = 5
CODES_PER_V: Final = 3276.7
"""Scale of inputs and outputs, which span ±10 V."""
GAIN: Final = 15.0
"""Gain of the amplifier behind an output: 10 V drive 150 V at the actuator."""
_FULL: Final = 0x7FFF
_MS: Final = 1_000_000
# Error codes of emergencies (CiA 301).
_HEARTBEAT_LOST: Final = 0x8130
_LENGTH: Final = 0x8210
_COMMUNICATION: Final = 0x11
"""Bits of the error register: communication error, generic error."""
_RPDO: Final = 0x1401
_TPDO: Final = 0x1801
_LAST_SYNC_TYPE: Final = 240
_MAPPABLE: Final = {0x1601: ("rpdo", "both"), 0x1A01: ("tpdo", "both")}
_STATES: Final = {o.START: o.OPERATIONAL, o.STOP: o.STOPPED, o.PREPARE: o.PREOPERATIONAL}


class Cia401Node:
    """Implements `Node`: input n is the conditioned sensor of axis n, output n its amplifier.

    Args:
        bench: The rig; inputs and outputs without an axis are open.
        serial: Serial number.
    """

    def __init__(self, bench: SharedRig, serial: int = SERIAL) -> None:
        self._bench = bench
        self._entries = object_dictionary(NODE, serial)
        self._values: dict[tuple[int, int], int | str] = {}
        self._server = SdoServer(self)
        self._heartbeat_sent_ns = 0
        self._outgoing: list[Frame] = []
        self._power_up()
        for i in range(min(N_CHANNELS, bench.n_axes)):
            code = round(bench.drive_v(i) / GAIN * CODES_PER_V)
            # The rig may already be driven, by an earlier emulator: the node starts with its
            # present voltage.
            self._values[o.OUTPUT, i + 1] = min(max(code, -_FULL), _FULL)

    def _power_up(self) -> None:
        self._values = {place: entry.value for place, entry in self._entries.items()}
        self._state = o.BOOTED
        self._consumer = HeartbeatConsumer()
        self._waiting: dict[int, bytes] = {}  # process data for the next SYNC
        self._syncs = 0
        self._outgoing.clear()

    def receive(self, frame: Frame) -> list[Frame]:
        """Process a frame of the bus and return the replies."""
        if not frame.is_plain:
            return []
        if frame.id == o.NMT:
            return self._handle_nmt(frame.data)
        # A stopped node answers no SDO (CiA 301).
        if frame.id == o.SDO_REQUEST + NODE and self._state != o.STOPPED:
            answer = self._server.answer(frame.data)
            return [] if answer is None else [Frame(o.SDO_ANSWER + NODE, answer)]
        if frame.id == self._int(o.SYNC_ID, 0):
            return self._sync()
        if frame.id == self._int(_RPDO, 1) & ~o.DISABLED:
            return self._handle_rpdo(frame.data)
        self._consumer.hear(frame.id - o.HEARTBEAT, self._bench.now_ns())
        return []

    def due(self) -> list[Frame]:
        """Return the frames that are due: boot-up, heartbeats, emergencies."""
        frames, self._outgoing = self._outgoing, []
        now_ns = self._bench.now_ns()
        if self._state == o.BOOTED:
            frames.append(self._heartbeat())
            self._state, self._heartbeat_sent_ns = o.PREOPERATIONAL, now_ns
        if self._consumer.take_loss(now_ns):
            frames += self._handle_lost_host()
        period_ns = self._int(o.PRODUCER_HEARTBEAT, 0) * _MS
        if period_ns and now_ns - self._heartbeat_sent_ns >= period_ns:
            self._heartbeat_sent_ns = now_ns
            frames.append(self._heartbeat())
        return frames

    def foreign(self) -> Frame:
        """Return process data for the outputs, which only the host should send."""
        return Frame(self._int(_RPDO, 1) & 0x7FF, bytes(2 * self._int(_RPDO + 0x200, 0)))

    def emergency(self, code: int, register: int) -> None:
        """Queue an emergency and set the error register."""
        self._values[o.ERROR_REGISTER, 0] = register
        self._outgoing.append(self._emergency(code))

    def entry(self, index: int, number: int) -> Entry:
        """Return an object.

        Raises:
            AbortError: If it does not exist.
        """
        if (index, 0) not in self._entries:
            raise AbortError(AbortCode.NO_OBJECT)
        if (index, number) not in self._entries:
            raise AbortError(AbortCode.NO_SUB_INDEX)
        return self._entries[index, number]

    def value(self, index: int, number: int) -> int | str:
        """Return the value of an object."""
        if index == o.INPUT and number:
            return self._input_code(number - 1)
        return self._values[index, number]

    def set(self, index: int, number: int, value: int) -> None:
        """Write an object.

        Raises:
            AbortError: If this value is not allowed, or not in the present state.
        """
        if index in _MAPPABLE:
            self._check_mapping(index, number, value)
        if index in {_RPDO, _TPDO} and number == 2 and _LAST_SYNC_TYPE < value < 254:
            raise AbortError(AbortCode.OUT_OF_RANGE)
        if index == o.CONSUMER_HEARTBEAT:
            self._consumer.configure(value)
        self._values[index, number] = value
        if index == o.OUTPUT:
            self._drive(number - 1, value)

    def _check_mapping(self, index: int, number: int, value: int) -> None:
        if self._state == o.OPERATIONAL or not self._int(index - 0x200, 1) & o.DISABLED:
            raise AbortError(AbortCode.WRONG_STATE)
        if number == 0:
            if value > N_CHANNELS:
                raise AbortError(AbortCode.TOO_MUCH_MAPPED)
            return
        # The entries can only be written while their number is 0.
        if self._int(index, 0):
            raise AbortError(AbortCode.UNSUPPORTED_ACCESS)
        entry = self.entry(value >> 16, value >> 8 & 0xFF)
        if entry.mapping not in _MAPPABLE[index] or 8 * entry.n_bytes != value & 0xFF:
            raise AbortError(AbortCode.CANNOT_BE_MAPPED)

    def _handle_nmt(self, data: bytes) -> list[Frame]:
        # Node number 0 addresses all nodes.
        if len(data) != 2 or data[1] not in {0, NODE}:
            return []
        if data[0] in {o.RESET, o.RESET_COMMUNICATION}:
            # A reset takes the outputs to 0, like switching the node off and on.
            for axis in range(N_CHANNELS):
                self._drive(axis, 0)
            self._power_up()
            return self.due()
        self._state = _STATES.get(data[0], self._state)
        if self._state == o.STOPPED:
            self._make_safe()
        return []

    def _sync(self) -> list[Frame]:
        if self._state != o.OPERATIONAL:
            return []
        for data in self._waiting.values():
            self._set_outputs(data)
        self._waiting.clear()
        self._syncs += 1
        kind, identifier = self._int(_TPDO, 2), self._int(_TPDO, 1)
        # Transmission types 1 to 240: at every n-th SYNC.
        if identifier & o.DISABLED or not 0 < kind <= _LAST_SYNC_TYPE or self._syncs % kind:
            return []
        data = b"".join(
            (int(self.value(entry >> 16, entry >> 8 & 0xFF)) % (1 << (entry & 0xFF))).to_bytes(
                (entry & 0xFF) // 8, "little"
            )
            for entry in self._mapping(_TPDO)
        )
        return [Frame(identifier & 0x7FF, data)]

    def _handle_rpdo(self, data: bytes) -> list[Frame]:
        if self._state != o.OPERATIONAL or self._int(_RPDO, 1) & o.DISABLED:
            return []
        # Process data that is too short raises an emergency; a longer one is accepted (CiA 301).
        if len(data) < sum(entry & 0xFF for entry in self._mapping(_RPDO)) // 8:
            return [self._emergency(_LENGTH)]
        # A synchronous PDO takes effect with the next SYNC.
        if self._int(_RPDO, 2) <= _LAST_SYNC_TYPE:
            self._waiting[_RPDO] = data
        else:
            self._set_outputs(data)
        return []

    def _set_outputs(self, data: bytes) -> None:
        for i, entry in enumerate(self._mapping(_RPDO)):
            code = int.from_bytes(data[2 * i : 2 * i + 2], "little", signed=True)
            number = entry >> 8 & 0xFF
            self._values[o.OUTPUT, number] = code
            self._drive(number - 1, code)

    def _handle_lost_host(self) -> list[Frame]:
        """React to a missing heartbeat of the host."""
        self._make_safe()
        # 0: leave the state operational; 1: keep the state; 2: stop (CiA 301, object 0x1029).
        if self._int(o.ERROR_BEHAVIOUR, 1) == 0 and self._state == o.OPERATIONAL:
            self._state = o.PREOPERATIONAL
        elif self._int(o.ERROR_BEHAVIOUR, 1) == 2:
            self._state = o.STOPPED
        self._values[o.ERROR_REGISTER, 0] = _COMMUNICATION
        return [self._emergency(_HEARTBEAT_LOST)]

    def _make_safe(self) -> None:
        for number in range(1, N_CHANNELS + 1):
            if self._int(o.ERROR_MODE, number):
                code = min(max(self._int(o.ERROR_VALUE, number), -_FULL), _FULL)
                self._values[o.OUTPUT, number] = code
                self._drive(number - 1, code)

    def _input_code(self, axis: int) -> int:
        if axis >= self._bench.n_axes:
            return 0
        sensor_v = self._bench.conditioned_v(axis)
        # A sensor without signal drives its output to the end of the range.
        return _FULL if isnan(sensor_v) else min(max(round(sensor_v * CODES_PER_V), -_FULL), _FULL)

    def _drive(self, axis: int, code: int) -> None:
        if axis < self._bench.n_axes:
            self._bench.drive(axis, code / CODES_PER_V * GAIN)

    def _mapping(self, settings: int) -> list[int]:
        # Mapping 0x1600 belongs to settings 0x1400, 0x1A00 to 0x1800.
        mapping = settings + 0x200
        return [self._int(mapping, i + 1) for i in range(self._int(mapping, 0))]

    def _heartbeat(self) -> Frame:
        return Frame(o.HEARTBEAT + NODE, bytes((self._state,)))

    def _emergency(self, code: int) -> Frame:
        register = self._int(o.ERROR_REGISTER, 0)
        data = code.to_bytes(2, "little") + bytes((register,)) + bytes(5)
        return Frame(o.EMERGENCY + NODE, data)

    def _int(self, index: int, number: int) -> int:
        return int(self._values[index, number])


def _make(bench: SharedRig, serial: str) -> Cia401Node:
    return Cia401Node(bench, int(serial) if serial.isdecimal() else SERIAL)


_NAME: Final = "canopen-401"
EMULATOR: Final = EmulatorPlugin(
    name=_NAME,
    summary="a CANopen node with analogue inputs and outputs, behind an slcan adapter or in a UDP "
    "group",
    wire="can",
    serve=serving(_NAME, _make),
)
