"""The device of a case, cycle by cycle."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from benchmarks.bus.cases import Case
from benchmarks.bus.example import placed
from piezod.config.daemon import load_daemon
from piezod.devices import registry
from piezod.devices.wiring import construct, pairs_of


@contextmanager
def driven(case: Case, where: str) -> Iterator[Any]:
    """Open and activate the device of a case while the block runs."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
        yaml.safe_dump(placed(case.example, [where], case.place), file)
        file.flush()
        config = load_daemon(Path(file.name), registry)
    (device,) = construct(config.devices, pairs_of(config.axes), config.seed).values()
    opened: Any = device
    opened.open()
    try:
        opened.activate(time.monotonic_ns())
        yield opened
    finally:
        opened.close()


def in_force(device: Any) -> list[float]:
    """Return the present outputs, so that writing them moves nothing; 0 if unknown."""
    voltages = device.read_back(time.monotonic_ns())
    return [value if isfinite(value) else 0.0 for value in voltages]


def timed_cycles_us(device: Any, values: Sequence[float], cycles: int) -> list[float]:
    """Run cycles of the loop with these values; return the duration of each, in µs."""
    took_us = []
    able = device.capabilities()
    for _ in range(cycles):
        begin_ns = time.monotonic_ns()
        device.read(begin_ns)
        if able.read_back:
            device.read_back(begin_ns)
        device.write(values, begin_ns)
        device.status(begin_ns)
        took_us.append((time.monotonic_ns() - begin_ns) / 1e3)
    return took_us
