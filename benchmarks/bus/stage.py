"""The driver of a case, cycle by cycle."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from benchmarks.bus.cases import Case
from piezod.devices import registry


@contextmanager
def driven(case: Case, where: str) -> Iterator[Any]:
    """Open and activate the device of a case, while the block runs."""
    plugin = registry.load(case.driver)
    options = plugin.options_model.model_validate(case.options(where))
    device = plugin.create(options, case.wiring, 1)
    device.open()
    try:
        device.activate(time.monotonic_ns())
        yield device
    finally:
        device.close()


def timed_cycles_us(device: Any, cycles: int) -> list[float]:
    """Run cycles as the loop does; return how long each took, in µs."""
    took_us = []
    able = device.capabilities()
    low_v = list(device.read_back(time.monotonic_ns()))
    drive_v = [value if value == value else 0.0 for value in low_v]  # noqa: PLR0124 - not NaN
    for _ in range(cycles):
        begin_ns = time.monotonic_ns()
        if able.inputs:
            device.read(begin_ns)
        if able.read_back:
            device.read_back(begin_ns)
        if able.outputs:
            device.write(drive_v, begin_ns)
        device.status(begin_ns)
        took_us.append((time.monotonic_ns() - begin_ns) / 1e3)
    return took_us
