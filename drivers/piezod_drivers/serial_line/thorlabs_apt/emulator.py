"""The emulated KPZ101 and KSG101.

They behave as the maker's "Host-Controller Communications Protocol", issue 28, describes it. An
unknown request has no reply.
"""

import zlib
from collections.abc import Callable
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator, EmulatorPlugin
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import (
    FULL_SCALE,
    HOST,
    UNIT,
    AptFrameError,
    CubeStatus,
    DisplayMode,
    Hardware,
    Id,
    StatusBit,
)

MAX_V: Final = 150
TRAVEL_UM: Final = 30.0
_LIMIT_150_V: Final = 3
_UPDATE_NS: Final = 100_000_000
_MAX_UNACKNOWLEDGED: Final = 50
"""Statuses, requested or not, that are sent without an acknowledgement of the host."""
_INCOMPLETE_NS: Final = 50_000_000
"""An incomplete message is dropped after this time; not confirmed."""
_CHANNEL: Final = 1
_ENABLED: Final = 1
_DISABLED: Final = 2
_SOFTWARE: Final = 0
_OPEN_LOOP_MODES: Final = frozenset({1, 3})

_Handler = Callable[[bytes], list[bytes]]


class _CubeEmulator(Emulator):
    """The common part of both cubes.

    Args:
        bench: The rig; its clock is used.
    """

    def __init__(self, bench: SharedRig, hardware: Hardware) -> None:
        self._bench, self._hardware = bench, hardware
        self._got, self._got_ns = b"", 0
        self._handlers: dict[int, _Handler] = {Id.REQ_INFO: self._info}

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to every complete message."""
        now_ns = self._bench.now_ns()
        if now_ns - self._got_ns > _INCOMPLETE_NS:
            self._got = b""
        self._got, self._got_ns = self._got + data, now_ns
        replies: list[bytes] = []
        while length := codec.length_to_unit(self._got):
            frame, self._got = self._got[: abs(length)], self._got[abs(length) :]
            handler = self._handlers.get(codec.ident_of(frame)) if length > 0 else None
            if handler is not None:
                try:
                    replies += handler(frame)
                except AptFrameError:
                    continue
        return replies

    def _info(self, _frame: bytes) -> list[bytes]:
        return [_answer(Id.GET_INFO, codec.pack_hardware(self._hardware))]


class KpzEmulator(_CubeEmulator):
    """A KPZ101. After power-up it is disabled at 0 V, and only the host sets its voltage.

    Args:
        bench: The rig; its first axis is the actuator.
        serial: Serial number, "" for the usual one.
    """

    def __init__(self, bench: SharedRig, serial: str) -> None:
        super().__init__(bench, Hardware(_number(serial, 29_000_001), "KPZ101", "1.0.3"))
        # Mode 1 is open loop.
        self._output, self._enabled, self._mode = 0, _DISABLED, 1
        self.source = _SOFTWARE
        self._updating, self._unacknowledged, self._update_ns = False, 0, 0
        self._handlers |= {
            Id.SET_OUTPUT: self._set_output,
            Id.REQ_OUTPUT: lambda _: [_answer_words(Id.GET_OUTPUT, self._output)],
            Id.SET_ENABLED: self._set_enabled,
            Id.REQ_ENABLED: lambda _: [_answer_short(Id.GET_ENABLED, self._enabled)],
            Id.SET_CONTROL_MODE: self._set_mode,
            Id.REQ_CONTROL_MODE: lambda _: [_answer_short(Id.GET_CONTROL_MODE, self._mode)],
            Id.SET_SOURCE: self._set_source,
            Id.REQ_SOURCE: lambda _: [_answer_words(Id.GET_SOURCE, self.source)],
            # Data of `GET_IO`: channel, voltage limit, then settings that the driver does not use.
            Id.REQ_IO: lambda _: [_answer(Id.GET_IO, bytes((1, 0, _LIMIT_150_V, *[0] * 7)))],
            Id.REQ_STATUS: lambda _: self._statuses(),
            Id.START_UPDATES: self._start_updates,
            Id.STOP_UPDATES: self._stop_updates,
            Id.ACK_STATUS: self._acknowledge_status,
        }

    def due(self) -> list[bytes]:
        """Return a status ten times a second while the host acknowledges them."""
        now_ns = self._bench.now_ns()
        if not self._updating or now_ns < self._update_ns:
            return []
        self._update_ns = now_ns + _UPDATE_NS
        return self._statuses()

    def _set_output(self, frame: bytes) -> list[bytes]:
        (counts,) = codec.words_of(frame, _CHANNEL)
        if 0 <= counts <= FULL_SCALE:
            self._output = counts
            self._drive()
        return []

    def _set_enabled(self, frame: bytes) -> list[bytes]:
        self._enabled = codec.short_of(frame)[1]
        self._drive()
        return []

    def _set_mode(self, frame: bytes) -> list[bytes]:
        self._mode = codec.short_of(frame)[1]
        self._drive()
        return []

    def _set_source(self, frame: bytes) -> list[bytes]:
        (self.source,) = codec.words_of(frame, _CHANNEL)
        return []

    def _drive(self) -> None:
        # In closed loop the voltage stays: there is no closed loop on the rig.
        if self._mode in _OPEN_LOOP_MODES:
            on = self._enabled == _ENABLED
            self._bench.drive(0, self._output / FULL_SCALE * MAX_V if on else 0.0)

    def _statuses(self) -> list[bytes]:
        # A host that is gone must not receive statuses for ever: the cube stops after 50.
        if self._unacknowledged >= _MAX_UNACKNOWLEDGED:
            return []
        self._unacknowledged += 1
        return [self._status()]

    def _status(self) -> bytes:
        counts = round(self._bench.drive_v(0) / MAX_V * FULL_SCALE)
        bits = StatusBit.ENABLED if self._enabled == _ENABLED else 0
        bits |= 0 if self._mode in _OPEN_LOOP_MODES else StatusBit.CLOSED_LOOP
        status = CubeStatus(max(-FULL_SCALE, min(counts, FULL_SCALE)), 0, bits)
        return _answer(Id.GET_STATUS, codec.pack_status(_CHANNEL, status))

    def _start_updates(self, _frame: bytes) -> list[bytes]:
        self._updating = True
        return []

    def _stop_updates(self, _frame: bytes) -> list[bytes]:
        self._updating = False
        return []

    def _acknowledge_status(self, _frame: bytes) -> list[bytes]:
        self._unacknowledged = 0
        return []


class KsgEmulator(_CubeEmulator):
    """A KSG101 whose actuator has a travel of 30 µm.

    Args:
        bench: The rig; its first axis has the gauge.
        serial: Serial number, "" for the usual one.
    """

    def __init__(self, bench: SharedRig, serial: str) -> None:
        super().__init__(bench, Hardware(_number(serial, 59_000_001), "KSG101", "1.0.2"))
        self._display_mode: int = DisplayMode.POSITION
        # In steps of 100 nm.
        travel = round(TRAVEL_UM * 10)
        self._handlers |= {
            Id.REQ_MAX_TRAVEL: lambda _: [_answer_words(Id.GET_MAX_TRAVEL, travel)],
            Id.SET_GAUGE_IO: self._set_io,
            Id.REQ_GAUGE_IO: lambda _: [
                _answer(Id.GET_GAUGE_IO, codec.pack_gauge_io(_CHANNEL, self._display_mode))
            ],
            Id.REQ_READING: lambda _: [self._reading()],
        }

    def _set_io(self, frame: bytes) -> list[bytes]:
        self._display_mode = codec.display_mode_of(frame)
        return []

    def _reading(self) -> bytes:
        position_um = self._bench.position_um(0)
        counts = FULL_SCALE if not isfinite(position_um) else self._counts(position_um)
        counts = max(-FULL_SCALE, min(counts, FULL_SCALE))
        return _answer(Id.GET_READING, codec.words(_CHANNEL, counts, counts))

    def _counts(self, position_um: float) -> int:
        full_scale = FULL_SCALE * position_um / TRAVEL_UM
        # Any other quantity has another scale; half of it stands for that.
        return round(full_scale if self._display_mode == DisplayMode.POSITION else full_scale / 2)


def _number(serial: str, usual: int) -> int:
    if not serial:
        return usual
    # The message holds a number; other text gets one that is always the same.
    return int(serial) if serial.isdecimal() else zlib.crc32(serial.encode()) & 0x7FFFFFFF


def _answer(ident: int, data: bytes) -> bytes:
    return codec.long(ident, data, to=HOST, source=UNIT)


def _answer_short(ident: int, value: int) -> bytes:
    return codec.short(ident, _CHANNEL, value, to=HOST, source=UNIT)


def _answer_words(ident: int, value: int) -> bytes:
    return _answer(ident, codec.words(_CHANNEL, value))


KPZ101: Final = EmulatorPlugin(
    name="kpz101",
    summary="Thorlabs KPZ101 piezo amplifier, 0 to 150 V",
    wire="serial",
    create=KpzEmulator,
)
KSG101: Final = EmulatorPlugin(
    name="ksg101",
    summary="Thorlabs KSG101 strain gauge reader, 30 µm",
    wire="serial",
    create=KsgEmulator,
)
