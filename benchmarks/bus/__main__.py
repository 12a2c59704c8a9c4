"""What a driver's cycle costs beside plain system calls on the same bytes, to the same peer.

`python -m benchmarks.bus` runs every bus, `python -m benchmarks.bus NAME…` those whose name holds
one of the words. A cycle is what the loop does: read the inputs, read back, write the outputs.
Rounds of the driver and of the floor take turns; the emulator is a process of its own, and its time
is part of both. At a real line rate the wire is the floor: its time is computed, and what the
driver adds to the bare system calls is told as a part of it.
"""

import sys
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.bus.cases import CASES, Case
from benchmarks.bus.floor import serial_floor, tcp_floor, timed_us
from benchmarks.bus.peer import emulated
from benchmarks.bus.recorded import Exchange, recording
from benchmarks.bus.stage import driven, timed_cycles_us

ROUNDS, CYCLES = 10, 500


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
        with driven(case, where) as device, recording() as exchanges:
            timed_cycles_us(device, 1)
            exchanges.clear()
            timed_cycles_us(device, 1)
            cycle = list(exchanges)
        floor = serial_floor if case.wire == "serial" else tcp_floor
        for _ in range(ROUNDS):
            with driven(case, where) as device:
                timed_cycles_us(device, 20)
                driver_us += timed_cycles_us(device, CYCLES)
            with floor(where, text=case.text) as ask:
                timed_us(ask, cycle, 20)
                floor_us += timed_us(ask, cycle, CYCLES)
    return _print(case, cycle, median(driver_us), median(floor_us))


def _print(case: Case, cycle: list[Exchange], driver_us: float, floor_us: float) -> bool:
    ratio = driver_us / floor_us
    wire = ""
    if case.baud:
        n_bytes = sum(len(each.request) + len(each.reply) for each in cycle)
        wire_us = 10 * n_bytes / case.baud * 1e6
        part = 100 * max(driver_us - floor_us, 0.0) / wire_us
        wire = (
            f"{n_bytes} bytes, {wire_us:.0f} µs at {case.baud} bit/s; overhead {part:.1f} % of it"
        )
    print(
        f"{case.name:28} {driver_us:10.1f} {floor_us:9.1f} {ratio:6.2f} {case.limit:6.1f}  {wire}"
    )
    return ratio <= case.limit


if __name__ == "__main__":
    main()
