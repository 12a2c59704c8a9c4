"""The read and write blocks of a configuration, for all devices of a line."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from piezod.devices.interface import Capabilities, Wiring
from piezod_drivers.modbus.blocks import ReadBlock, WriteBlock, read_blocks, write_blocks
from piezod_drivers.modbus.codec import WriteAndRead, set_coil
from piezod_drivers.modbus.options import ModbusOptions, UnitOptions
from piezod_drivers.modbus.profiles import PROFILES
from piezod_drivers.modbus.profiles.profile import ModbusProfile, WatchdogPlan
from piezod_drivers.modbus.register import Register, Role

FASTEST_TCP_HZ: Final = 1000.0
_RTU_BYTES: Final = 3  # around a request or a reply: unit and checksum


class Coil(NamedTuple):
    """An output of one bit."""

    unit: int  #: Address of the device.
    position: int  #: Index of the output.
    address: int  #: Address of the coil.


@dataclass(frozen=True, slots=True)
class RegisterLayout:
    """The blocks of a configuration, and their capabilities."""

    reads: list[ReadBlock]  #: Blocks of the inputs.
    read_backs: list[ReadBlock]  #: Blocks of the outputs' read-back.
    statuses: list[ReadBlock]  #: Blocks of the status.
    writes: list[WriteBlock]  #: Blocks of the outputs.
    coils: list[Coil]  #: Outputs of one bit.
    #: For each value of `statuses`: its register and the channels that it concerns; inputs are
    #: counted first.
    status: list[tuple[Register, list[int]]]
    ranges: list[tuple[float, float]]  #: Lowest and highest value of each output.
    #: Requests that set and read everything at once, one for each form of the only read block;
    #: empty if that is impossible.
    combined: list[WriteAndRead]
    capabilities: Capabilities  #: Capabilities of the device.


def profile_of(unit: UnitOptions) -> ModbusProfile | None:
    """Return the profile of a device; None if the configuration has its registers."""
    return PROFILES[unit.profile] if unit.profile else None


def watchdog_of(unit: UnitOptions, options: ModbusOptions) -> WatchdogPlan | None:
    """Return the watchdog that is to be armed; None if there is none."""
    profile = profile_of(unit)
    return profile.watchdog if profile is not None and options.watchdog is not None else None


def armed_watchdogs(options: ModbusOptions, wiring: Wiring) -> list[tuple[int, WatchdogPlan]]:
    """Return the watchdogs that are to be armed, of devices whose outputs are used.

    The others would trip, because nothing sets their outputs.

    Returns:
        Address of each device, and how its watchdog is armed.
    """
    return [
        (unit.unit, plan)
        for unit in options.every_unit
        if (plan := watchdog_of(unit, options))
        and _positions_of(unit.known, "output", wiring.outputs)
    ]


def write_functions_of(unit: UnitOptions, options: ModbusOptions) -> tuple[int, ...]:
    """Return the functions that may be used to write to a device."""
    profile = profile_of(unit)
    functions = unit.write_functions if profile is None else profile.write_functions
    watchdog = watchdog_of(unit, options)
    return functions if watchdog is None or not watchdog.writes else watchdog.writes


def make_layout(options: ModbusOptions, wiring: Wiring) -> RegisterLayout:
    """Return the blocks for the channels in use.

    The highest rate on a serial line is computed for a cycle that reads every input, sets every
    output, coils included, and reads it back.
    """
    reads, read_backs, statuses, writes = [], [], [], []
    coils: list[Coil] = []
    status: list[tuple[Register, list[int]]] = []
    n_outputs = len(wiring.outputs)
    ranges = [(0.0, 0.0)] * n_outputs
    read_back_positions, quality = set(), False
    for unit in options.every_unit:
        # Registers that are only written may be unreadable.
        readable = [register for register in unit.known if register.role != "output"]
        inputs = _positions_of(unit.known, "input", wiring.inputs)
        outputs = _positions_of(unit.known, "output", wiring.outputs)
        back = _positions_of(unit.known, "read-back", wiring.outputs)
        unit_positions = [position for position, _ in inputs]
        unit_positions += [len(wiring.inputs) + position for position, _ in outputs]
        own = [
            (len(status) + i, register)
            for i, register in enumerate(_statuses(unit.known, (*inputs, *outputs)))
        ]
        status += [(register, _channels(register, wiring, unit_positions)) for _, register in own]
        reads += read_blocks(unit.unit, inputs, readable)
        read_backs += read_blocks(unit.unit, back, readable)
        statuses += read_blocks(unit.unit, own, readable)
        words = [each for each in outputs if not each[1].sets_coil]
        writes += write_blocks(unit.unit, words, write_functions_of(unit, options))
        coils += [Coil(unit.unit, i, each.address) for i, each in outputs if each.sets_coil]
        read_back_positions |= {position for position, _ in back}
        quality |= any(register.range is not None for _, register in inputs)
        for position, register in outputs:
            ranges[position] = (register.low, register.high)
    combined = _combined(options, reads, writes)
    return RegisterLayout(
        reads,
        read_backs,
        statuses,
        writes,
        coils,
        status,
        ranges,
        combined,
        Capabilities(
            wiring.inputs,
            wiring.outputs,
            read_back=len(read_back_positions) == n_outputs - len(coils) > 0,
            max_rate_hz=_fastest_hz(
                options, n_outputs, (*reads, *read_backs), writes, combined, coils
            ),
            holds=True,
            watchdog=bool(armed_watchdogs(options, wiring)),
            quality=quality,
        ),
    )


def _positions_of(
    known: Sequence[Register], role: Role, names: Sequence[str]
) -> list[tuple[int, Register]]:
    return [
        (names.index(register.channel), register)
        for register in known
        if register.role == role and register.channel in names
    ]


def _statuses(known: Sequence[Register], used: Sequence[tuple[int, Register]]) -> list[Register]:
    names = {register.channel for _, register in used}
    return [
        register
        for register in known
        if register.role == "status" and (register.channel is None or register.channel in names)
    ]


def _channels(register: Register, wiring: Wiring, of_unit: list[int]) -> list[int]:
    if register.channel is None:
        return of_unit
    names = (*wiring.inputs, *wiring.outputs)
    return [position for position in of_unit if names[position] == register.channel]


def _combined(
    options: ModbusOptions, reads: Sequence[ReadBlock], writes: Sequence[WriteBlock]
) -> list[WriteAndRead]:
    # One request can combine one read and one write of one device.
    if not len(options.every_unit) == len(reads) == len(writes) == 1:
        return []
    (block,), (write,) = reads, writes
    if 23 not in write_functions_of(options.every_unit[0], options):
        return []
    return [WriteAndRead(write.start, write.count, block.start, count) for count in block.counts]


def _fastest_hz(
    options: ModbusOptions,
    n_outputs: int,
    reads: Sequence[ReadBlock],
    writes: Sequence[WriteBlock],
    combined: Sequence[WriteAndRead],
    coils: Sequence[Coil],
) -> float:
    profiles = [profile_of(unit) for unit in options.every_unit]
    limits = [profile.max_rate_hz for profile in profiles if profile is not None]
    if options.port is None:
        return min(limits, default=FASTEST_TCP_HZ)
    # The last form is the longest.
    requests = [block.requests[-1] for block in reads]
    if combined:
        # The combined request replaces the read and the write.
        requests[0] = combined[-1].request(b"\0\0" * writes[0].count)
    else:
        values = [0.0] * n_outputs
        requests += [request for write in writes for request in write.requests(values)[0]]
    requests += [set_coil(coil.address, on=False) for coil in coils]
    n_bytes = sum(len(each.pdu) + each.n_bytes + 2 * _RTU_BYTES for each in requests)
    # Bytes of requests and replies; each request is preceded by a silence of the line.
    wire_s = n_bytes * options.character_s + len(requests) * options.silence_s
    return min([1 / wire_s if wire_s else FASTEST_TCP_HZ, *limits])
