"""Which questions a configuration leads to, for all devices of a line."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from piezod.devices.interface import Capabilities, Wiring
from piezod_drivers.modbus.blocks import ReadBlock, WriteBlock, read_blocks, write_blocks
from piezod_drivers.modbus.codec import WriteAndRead
from piezod_drivers.modbus.options import ModbusOptions, UnitOptions
from piezod_drivers.modbus.profiles import PROFILES
from piezod_drivers.modbus.profiles.profile import ModbusProfile, WatchdogPlan
from piezod_drivers.modbus.register import Register, Role

FASTEST_TCP_HZ: Final = 1000.0
_RTU_BYTES: Final = 3  # unit and checksum


@dataclass(frozen=True, slots=True)
class RegisterLayout:
    """The questions.

    Attributes:
        reads: For the inputs.
        backs: For what is in force on the outputs.
        statuses: For the status.
        writes: For the outputs.
        status: Of each value of `statuses`: its register, and the channels it is about, the inputs
            counted first.
        ranges: Lowest and highest value of each output.
        together: Sets all and reads all at once, for each form of the only read; or nothing.
        able: What all that can do.
    """

    reads: list[ReadBlock]
    backs: list[ReadBlock]
    statuses: list[ReadBlock]
    writes: list[WriteBlock]
    status: list[tuple[Register, list[int]]]
    ranges: list[tuple[float, float]]
    together: list[WriteAndRead]
    able: Capabilities


def profile_of(unit: UnitOptions) -> ModbusProfile | None:
    """Return what is known of a device; None where it is described by registers."""
    return PROFILES[unit.profile] if unit.profile else None


def watchdog_of(unit: UnitOptions, options: ModbusOptions) -> WatchdogPlan | None:
    """Return the watchdog that is to be armed; None where none is."""
    profile = profile_of(unit)
    return profile.watchdog if profile is not None and options.watchdog is not None else None


def watched(options: ModbusOptions, wiring: Wiring) -> list[tuple[int, WatchdogPlan]]:
    """Return the watchdogs that are to be armed, of devices whose outputs are used.

    Others would trip, as nobody sets their outputs.

    Returns:
        The address of each device, and how its watchdog is armed.
    """
    return [
        (unit.unit, plan)
        for unit in options.every_unit
        if (plan := watchdog_of(unit, options)) and _placed(unit.known, "output", wiring.outputs)
    ]


def writes_of(unit: UnitOptions, options: ModbusOptions) -> tuple[int, ...]:
    """Tell the functions that may be used for writing to a device."""
    profile = profile_of(unit)
    functions = unit.write_functions if profile is None else profile.write_functions
    watchdog = watchdog_of(unit, options)
    return functions if watchdog is None or not watchdog.writes else watchdog.writes


def lay_out(options: ModbusOptions, wiring: Wiring) -> RegisterLayout:
    """Plan the questions for the channels that are used.

    The rate that a serial line lets through is for a cycle that reads every input, sets every
    output and reads it back.
    """
    reads, backs, statuses, writes = [], [], [], []
    status: list[tuple[Register, list[int]]] = []
    n_outputs = len(wiring.outputs)
    ranges = [(0.0, 0.0)] * n_outputs
    told, quality = set(), False
    for unit in options.every_unit:
        readable = [register for register in unit.known if register.role != "output"]
        inputs = _placed(unit.known, "input", wiring.inputs)
        outputs = _placed(unit.known, "output", wiring.outputs)
        back = _placed(unit.known, "read-back", wiring.outputs)
        concerned = [place for place, _ in inputs]
        concerned += [len(wiring.inputs) + place for place, _ in outputs]
        own = [
            (len(status) + i, register)
            for i, register in enumerate(_statuses(unit.known, (*inputs, *outputs)))
        ]
        status += [(register, _channels(register, wiring, concerned)) for _, register in own]
        reads += read_blocks(unit.unit, inputs, readable)
        backs += read_blocks(unit.unit, back, readable)
        statuses += read_blocks(unit.unit, own, readable)
        writes += write_blocks(unit.unit, outputs, writes_of(unit, options))
        told |= {place for place, _ in back}
        quality |= any(register.range is not None for _, register in inputs)
        for place, register in outputs:
            ranges[place] = (register.low, register.high)
    together = _together(options, reads, writes)
    return RegisterLayout(
        reads,
        backs,
        statuses,
        writes,
        status,
        ranges,
        together,
        Capabilities(
            wiring.inputs,
            wiring.outputs,
            read_back=len(told) == n_outputs > 0,
            max_rate_hz=_fastest_hz(options, n_outputs, (*reads, *backs), writes, together),
            holds=True,
            watchdog=bool(watched(options, wiring)),
            quality=quality,
        ),
    )


def _placed(
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
    return [place for place in of_unit if names[place] == register.channel]


def _together(
    options: ModbusOptions, reads: Sequence[ReadBlock], writes: Sequence[WriteBlock]
) -> list[WriteAndRead]:
    if not len(options.every_unit) == len(reads) == len(writes) == 1:
        return []
    (block,), (write,) = reads, writes
    if 23 not in writes_of(options.every_unit[0], options):
        return []
    return [WriteAndRead(write.start, write.count, block.start, count) for count in block.counts]


def _fastest_hz(
    options: ModbusOptions,
    n_outputs: int,
    reads: Sequence[ReadBlock],
    writes: Sequence[WriteBlock],
    together: Sequence[WriteAndRead],
) -> float:
    profiles = [profile_of(unit) for unit in options.every_unit]
    limits = [profile.max_rate_hz for profile in profiles if profile is not None]
    if options.port is None:
        return min(limits, default=FASTEST_TCP_HZ)
    requests = [block.requests[-1] for block in reads]
    if together:
        requests[0] = together[-1].request(b"\0\0" * writes[0].count)
    else:
        values = [0.0] * n_outputs
        requests += [request for write in writes for request in write.requests(values)[0]]
    n_bytes = sum(len(each.pdu) + each.n_bytes + 2 * _RTU_BYTES for each in requests)
    wire_s = n_bytes * options.character_s + len(requests) * options.silence_s
    return min([1 / wire_s if wire_s else FASTEST_TCP_HZ, *limits])
