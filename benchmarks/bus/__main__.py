"""Compares a driver's cycle with plain system calls for the same bytes, to the same peer.

`python -m benchmarks.bus` runs every bus, `python -m benchmarks.bus NAME…` those whose name
contains one of the words. A cycle is that of the loop: read the inputs, read back, write the
outputs. Rounds of the driver and of the floor (the plain system calls) alternate. The emulator is a
process of its own, and its time is part of both. At a real line rate the wire is the floor: its
time is computed, and the driver's additional time is given as a fraction of it.
"""

import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.bus.cases import CASES, Case
from benchmarks.bus.floor import serial_floor, tcp_floor, timed_us, udp_floor
from benchmarks.bus.peer import emulated
from benchmarks.bus.recorded import Recorded, recording
from benchmarks.bus.stage import driven, in_force, timed_cycles_us

ROUNDS, CYCLES = 10, 300
FLOORS = {"serial": serial_floor, "tcp": tcp_floor, "udp": udp_floor}


def main() -> None:
    """Measure and print."""
    words = sys.argv[1:]
    chosen = [each for each in CASES if not words or any(word in each.name for word in words)]
    print(f"{'bus':28} {'driver µs':>10} {'floor µs':>9} {'ratio':>6} {'limit':>6}  wire")
    missed = [case.name for case in chosen if not _measure(case)]
    if missed:
        print(f"above the limit: {', '.join(missed)}")


def _measure(case: Case) -> bool:
    driver_us: list[float] = []
    floor_us: list[float] = []
    with tempfile.TemporaryDirectory() as folder, emulated(case, Path(folder)) as where:
        for _ in range(ROUNDS):
            with driven(case, where) as device:
                values = in_force(device)
                cycle = _recorded(case, device, values)
                timed_cycles_us(device, values, 20)
                driver_us += timed_cycles_us(device, values, CYCLES)
                if case.wire != "tcp":
                    floor_us += _floor_us(case, cycle, where)
            if case.wire == "tcp":  # the device serves one connection at a time
                floor_us += _floor_us(case, cycle, where)
    return _print(case, cycle, median(driver_us), median(floor_us))


def _recorded(case: Case, device: Any, values: list[float]) -> Recorded:
    """Return the bytes of a cycle on the line.

    If the peer also sends by itself, the second of two cycles with equally many bytes is used: it
    has no such bytes.
    """
    before: list[int] = []
    with recording() as exchanges:
        timed_cycles_us(device, values, 5)
        while True:
            exchanges.clear()
            timed_cycles_us(device, values, 1)
            sizes = [len(each.reply) for each in exchanges]
            if not case.unasked or sizes == before:
                return exchanges
            before = sizes


def _floor_us(case: Case, cycle: Recorded, where: str) -> list[float]:
    with FLOORS[case.wire](cycle.line, where, case) as ask:
        timed_us(ask, cycle, 20)
        return timed_us(ask, cycle, CYCLES)


def _print(case: Case, cycle: Recorded, driver_us: float, floor_us: float) -> bool:
    ratio = driver_us / floor_us
    wire = ""
    if case.line_rate:
        n_bytes = sum(len(each.request) + len(each.reply) for each in cycle)
        wire_us = case.bits_per_byte * n_bytes / case.line_rate * 1e6
        wire_us += len(cycle) * case.silence_us
        part = 100 * max(driver_us - floor_us, 0.0) / wire_us
        wire = f"{wire_us:.0f} µs at {case.line_rate} bit/s; overhead {part:.1f} % of it"
    print(
        f"{case.name:28} {driver_us:10.1f} {floor_us:9.1f} {ratio:6.2f} {case.limit:6.1f}  {wire}"
    )
    return ratio <= case.limit


if __name__ == "__main__":
    main()
