from math import isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.interface import Wiring
from piezod_drivers.modbus.blocks import FORMS, read_blocks, write_blocks
from piezod_drivers.modbus.driver import channels_of
from piezod_drivers.modbus.layout import make_layout
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.profiles import PROFILES
from piezod_drivers.modbus.register import Register


def register(role: str, address: int, **others: object) -> Register:
    """Return a register whose channel is named by its address."""
    rows: dict[str, object] = {"role": role, "address": address, "channel": f"c{address}"}
    if role == "output":
        rows["range"] = (0.0, 10.0)
    return Register.model_validate(rows | others)


def spans(wanted: list[int], known: list[int]) -> list[tuple[int, tuple[int, ...]]]:
    """Return the start and the lengths of the blocks for addresses."""
    rows = {address: register("input", address) for address in known}
    blocks = read_blocks(1, [(i, rows[address]) for i, address in enumerate(wanted)], rows.values())
    return [(block.start, block.counts) for block in blocks]


def test_registers_between_known_ones_are_read_with_them() -> None:
    """Registers are read together if all between them are known, else apart."""
    assert spans([0, 3], [0, 1, 2, 3]) == [(0, (4,))]
    assert spans([0, 3], [0, 1, 3]) == [(0, (1, 2)), (3, (1,))]
    assert spans([5], [5]) == [(5, (1,))]


def test_long_blocks_are_divided() -> None:
    """No request reads more than 125 registers."""
    assert spans([0, 100, 200, 250], list(range(251))) == [
        (0, (101, 102, 103)),
        (200, (51,)),
    ]


def test_forms_reach_no_further_than_known_registers() -> None:
    """A block is also read together with its next neighbours, if they are known."""
    assert spans([2], list(range(8))) == [(2, tuple(range(1, 1 + FORMS)))]
    assert spans([6], list(range(8))) == [(6, (1, 2))]


@given(st.sets(st.integers(0, 400), min_size=1, max_size=300), st.data())
def test_every_register_is_read_once_and_no_unknown_one(
    known: set[int], data: st.DataObject
) -> None:
    """Each wanted register is read once, no unknown one is read, and no request is too long."""
    wanted = data.draw(st.sets(st.sampled_from(sorted(known)), min_size=1))
    blocks = spans(sorted(wanted), sorted(known))
    read = [start + i for start, counts in blocks for i in range(counts[0])]
    assert wanted <= set(read)
    assert len(read) == len(set(read))
    for start, counts in blocks:
        assert set(range(start, start + counts[-1])) <= known
        assert counts[-1] <= 125


@pytest.mark.parametrize(
    ("functions", "n_requests"),
    [((6,), [[1], [1], [1]]), ((16,), [[1], [1]]), ((6, 16), [[1, 2], [1, 1]])],
)
def test_ways_to_write(functions: tuple[int, ...], n_requests: list[list[int]]) -> None:
    """Neighbours are written at once by function 16, or one by one by function 6."""
    wanted = [(i, register("output", address)) for i, address in enumerate((4, 5, 9))]
    blocks = write_blocks(1, wanted, functions)
    ways = [[len(way) for way in block.requests([1.0, 2.0, 3.0])] for block in blocks]
    assert ways == n_requests


@pytest.mark.parametrize(
    ("kind", "n_registers", "counts"), [("uint16", 130, [121, 9]), ("float32", 62, [120, 4])]
)
def test_long_writes_are_divided(kind: str, n_registers: int, counts: list[int]) -> None:
    """No request sets more than 121 registers or a part of a number."""
    step = 1 if kind == "uint16" else 2
    rows = [register("output", step * i, type=kind) for i in range(n_registers)]
    blocks = write_blocks(1, list(enumerate(rows)), (16,))
    assert [block.count for block in blocks] == counts
    values = [1.0] * n_registers
    assert max(len(block.requests(values)[0][0].pdu) for block in blocks) <= 253


def test_numbers_of_32_bits_are_written_by_function_16() -> None:
    """A number of two registers is never written in two requests."""
    block = write_blocks(1, [(0, register("output", 4, type="float32"))], (6,))[0]
    assert [way[0].pdu[0] for way in block.requests([1.0])] == [16]


def test_values_beyond_the_range_are_not_values() -> None:
    """An input at the end of its range gives NaN."""
    row = register("input", 0, type="int16", scale=0.1, range=(0.0, 10.0))
    block = read_blocks(1, [(0, row)], [row])[0]
    values = [nan]
    for number, expected in ((50, 5.0), (100, 10.0), (101, nan), (0xFFFF, nan)):
        block.decode(b"\x03\x02" + number.to_bytes(2, "big"), values)
        assert values == [pytest.approx(expected)] or (isnan(values[0]) and isnan(expected))


def test_coils_are_bits() -> None:
    """A coil of a block is read from its bit."""
    rows = [register("status", address, table="coil", flag="overload") for address in (3, 9, 12)]
    (block,) = read_blocks(
        1, list(enumerate(rows)), [*rows, *(_coil(address) for address in range(3, 13))]
    )
    values = [nan] * 3
    block.decode(b"\x01\x02\x41\x00", values)
    assert values == [1.0, 1.0, 0.0]


def _coil(address: int) -> Register:
    return register("status", address, table="coil", flag="overload")


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_every_profile_can_be_planned(name: str) -> None:
    """With all channels of a profile, each is read, set or both, and the rate is bounded."""
    options = ModbusOptions.model_validate({"profile": name, "port": "/dev/x", "baud": 9600})
    units = channels_of(options)
    layout = make_layout(options, Wiring(tuple(units.inputs), tuple(units.outputs)))
    assert len(layout.ranges) == len(units.outputs)
    assert 0 < layout.capabilities.max_rate_hz <= PROFILES[name].max_rate_hz
    assert set(units.inputs.values()) | set(units.outputs.values()) <= {"V", "mA"}


def test_the_rate_is_what_the_wire_lets_through() -> None:
    """The rate at 9600 bit/s is that of two longest reads, a write and three silences."""
    units = ({"unit": 1, "profile": "waveshare-ai8b"}, {"unit": 2, "profile": "waveshare-ao8b"})
    options = ModbusOptions.model_validate({"units": units, "port": "/dev/x", "baud": 9600})
    layout = make_layout(options, Wiring(("AI1",), ("AO1",)))
    longest_read, write = 8 + 5 + 2 * FORMS, 16
    wire_s = (2 * longest_read + write + 3 * 3.5) * 10 / 9600
    assert layout.capabilities.max_rate_hz == pytest.approx(1 / wire_s)
