"""The constants in the flash memory of an emulated LabJack, and the codes of its inputs."""

from collections.abc import Sequence
from functools import partial
from struct import pack
from typing import Final

from piezod_drivers.modbus.emulation.unit import (
    DEVICE_FAILURE,
    ILLEGAL_VALUE,
    EmulatedUnit,
    ModbusRefusal,
    RegisterPort,
)
from piezod_drivers.modbus.profiles import labjack_stream as registers
from piezod_drivers.modbus.profiles.labjack_stream import InputScale, StreamPlan, input_scale

_LAST_CODE: Final = 0xFFFF
_NEGATIVE_CH: Final = 41_000
_SINGLE_ENDED: Final = 199
_RANGE_INVALID: Final = 2382
_T4_HIGH: Final = (0.0003235316, -10.532965)
_T4_LOW: Final = (0.00003826692, 0.002484)
"""Nominal slope and offset of the inputs of a T4, in V."""
_T7: Final = (0.000315805780, -0.000315805800, 33_523.0, -10.586956522)
"""Nominal slopes, center and offset of a T7 in its largest range."""
_T8_SPAN_V: Final = 22.0


class Flash:
    """Flash memory with the scale of each input and range; no value is exactly the nominal one.

    Args:
        plan: Where the constants are.
        n_inputs: Number of inputs.
    """

    def __init__(self, plan: StreamPlan, n_inputs: int) -> None:
        self._plan, self._pointer = plan, 0
        self._ranges_v = [_default_v(plan, channel) for channel in range(n_inputs)]
        self._bytes: dict[int, bytes] = {}
        for channel in range(n_inputs):
            for range_v in plan.ranges:
                source = plan.scale_source(channel, range_v)
                assert source is not None  # noqa: S101 - it is a range of the plan
                self._bytes[source.address] = _constants(plan, channel, range_v)

    def add_to(self, unit: EmulatedUnit) -> None:
        """Add the registers of the memory, and those with the ranges of the inputs."""
        unit.add(
            "holding", registers.FLASH_POINTER, "uint32", lambda: self._pointer, self._set_pointer
        )
        unit.add_port(registers.FLASH_READ, RegisterPort(read=self._read))
        for channel in range(len(self._ranges_v)):
            unit.add(
                "holding",
                registers.AIN_RANGE + 2 * channel,
                "float32",
                partial(self._ranges_v.__getitem__, channel),
                partial(self._set_range, channel),
            )
            unit.add_stored("holding", _NEGATIVE_CH + channel, "uint16", _SINGLE_ENDED)

    def encode(self, channel: int, value_v: float) -> int:
        """Return the code of an input in its present range."""
        scale = self._scale(channel)
        above = value_v >= scale.offset
        code = scale.center + (value_v - scale.offset) / (scale.above if above else scale.below)
        return min(max(round(code), 0), _LAST_CODE)

    def _scale(self, channel: int) -> InputScale:
        return input_scale(_values(self._plan, channel, self._ranges_v[channel]))

    def _set_pointer(self, address: float) -> None:
        self._pointer = int(address)

    def _set_range(self, channel: int, range_v: float) -> None:
        if self._plan.scale_source(channel, range_v) is None:
            raise ModbusRefusal(DEVICE_FAILURE, _RANGE_INVALID)
        self._ranges_v[channel] = range_v or _default_v(self._plan, channel)

    def _read(self, n_words: int) -> bytes:
        if n_words % 2:
            raise ModbusRefusal(ILLEGAL_VALUE)
        end = self._pointer + 2 * n_words
        image = bytearray(b"\xff" * (2 * n_words))
        for address, constants in self._bytes.items():
            if self._pointer <= address and address + len(constants) <= end:
                start = address - self._pointer
                image[start : start + len(constants)] = constants
        return bytes(image)


def _default_v(plan: StreamPlan, channel: int) -> float:
    if plan.set_floats == 2 and channel >= plan.n_high:
        return 2.5
    return next(range_v for range_v in plan.ranges if range_v)


def _constants(plan: StreamPlan, channel: int, range_v: float) -> bytes:
    values = _values(plan, channel, range_v)
    return pack(f">{len(values)}f", *values)


def _values(plan: StreamPlan, channel: int, range_v: float) -> Sequence[float]:
    """Return the constants of an input in a range: the nominal ones with a small deviation."""
    range_v = range_v or _default_v(plan, channel)
    off = 1e-3 * (1 + min(channel, plan.n_high) % 5)
    if plan.set_floats == 2:
        slope, offset = _T4_HIGH if channel < plan.n_high else _T4_LOW
        return slope * (1 + off), offset * (1 + off)
    if not plan.sets_of_input:  # a T7: its inputs share one converter
        above, below, center, offset = _T7
        part = range_v / 10.0
        return above * part * 1.001, below * part * 0.9995, center - 4.5, offset * part
    slope = _T8_SPAN_V / 65_536 * range_v / 11.0 * (1 + off)
    return slope, -slope, 32_768.0 + channel, 0.0
