"""A converter card of the kernel: its driver comedi_test connects output n with input n.

Samples that a command of its clock takes are a sawtooth on input 0, whatever the outputs do.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, Final

import numpy as np

from piezod.devices import registry
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Progress, Table
from piezod.errors import DeviceError, PortHeldError
from tests.vm.guest import shell
from tests.vm.guest.buses import driven, faulted, recovered
from tests.vm.guest.shell import CheckError, attempt, need, run, wait_until
from tests.vm.guest.stage import Stage

PORT: Final = "/dev/comedi0"
CYCLE_S: Final = 0.05
STEP_V: Final = 20 / 65535
PERIOD_US: Final = 100_000
"""Period of the sawtooth."""
STAGE: Final = Stage(
    "card",
    "open-loop.yaml",
    (
        ("rate_hz: 200", "rate_hz: 20"),
        (
            "driver: simulated, options: .*}}",
            "driver: comedi, options: {outputs: {x: {number: 3, measured_by: {number: 3}}}}}",
        ),
        (
            "amplifier: amplifier",
            "amplifier: {device: amplifier, channel: x, calibration: {kind: line, gain: 15}}",
        ),
    ),
)


@contextmanager
def card(inputs: dict[str, int], outputs: dict[str, int]) -> Iterator[Any]:
    """Open a card with these channels, and activate it."""
    plugin = registry.load("comedi")
    options = plugin.options_model.model_validate(
        {
            "port": PORT,
            "inputs": {name: {"number": number} for name, number in inputs.items()},
            "outputs": {
                name: {"number": number, "measured_by": {"number": number}}
                for name, number in outputs.items()
            },
        }
    )
    device = plugin.create(options, Wiring(tuple(inputs), tuple(outputs)), 1)
    device.open()
    try:
        device.activate(time.monotonic_ns())
        yield device
    finally:
        device.close()


def is_there() -> str:
    """Load the kernel's driver, and identify the card."""
    run("modprobe comedi_test")
    wait_until(lambda: attempt(f"test -c {PORT}").returncode == 0, PORT)
    with card({"in": 2}, {"out": 2}) as device:
        return f"{device.capabilities()}"


@shell.confirms(
    "comedi",
    "comedi",
    part="set-points and read-back by an input",
    by="comedi_test of Linux 6.1",
    kind="kernel driver",
)
def setpoints_are_read_back() -> str:
    """At 20 Hz, each set-point is what the input reads and what is read back."""
    taken_ns = []
    with card({"in": 2}, {"out": 2}) as device:
        for value_v in np.sin(np.arange(200) / 30) * 9.9:
            begin_ns = time.monotonic_ns()
            need(device.write([float(value_v)], begin_ns), f"{value_v} V is refused")
            (sample,) = device.read(begin_ns)
            (read_back_v,) = device.read_back(begin_ns)
            taken_ns.append(time.monotonic_ns() - begin_ns)
            for found_v in (sample.position_um, read_back_v):
                need(abs(found_v - value_v) <= 0.51 * STEP_V, f"{value_v} V is {found_v} V")
            time.sleep(max(0.0, CYCLE_S - taken_ns[-1] / 1e9))
        need(not device.write([10.1], begin_ns), "a voltage out of range is accepted")
        device.write([0.0], begin_ns)
    return f"200 cycles equal; a cycle takes {np.median(taken_ns) / 1e3:.0f} µs here"


@shell.confirms(
    "comedi", "comedi", part="tables", by="comedi_test of Linux 6.1", kind="kernel driver"
)
def play_comes_out() -> str:
    """Each value of a table is seen at the output, in order, and the last one stays.

    comedi_test leaves values out where the emulated processor was late: then it plays slower.
    """
    for interval_ms in (20, 60, 180, 540):
        seen, wanted = _played(interval_ms)
        rest = iter(wanted)
        need(all(value in rest for value in seen), f"{seen} is no part of {wanted}")
        if seen == wanted:
            return f"{len(wanted)} values equal, at {interval_ms} ms"
    raise CheckError(f"{len(seen)} of {len(wanted)} values")


def _played(interval_ms: int) -> tuple[list[float], list[float]]:
    """Play a table; return the values that were seen, and those of the table."""
    rising, wave = np.linspace(0, 1, 5)[:, None], 1 + np.arange(20)[:, None] % 7 / 10
    seen: list[float] = []
    with card({}, {"out": 3}) as device:
        loaded = device.load(Table(interval_ms * 1_000_000, rising, wave, 2))
        device.arm()
        device.start(time.monotonic_ns())
        need(not device.write([0.0], time.monotonic_ns()), "a set-point is accepted in a play")
        while (progress := device.progress(time.monotonic_ns())).state is PlayState.PLAYING:
            seen += device.read_back(time.monotonic_ns())
            time.sleep(0.001)
        need(progress == Progress(PlayState.ENDED, 2), f"{progress}")
        seen += device.read_back(time.monotonic_ns())
        need(device.write([0.0], time.monotonic_ns()), "a set-point is refused after a play")
    wanted = _changes(np.concatenate((loaded.lead_in, *([loaded.period] * 2)))[:, 0].tolist())
    # Before the first point the output has its value of before.
    return _changes([value for value in seen if value in wanted]), wanted


def _changes(values: list[float]) -> list[float]:
    """Return values without those that are the same as the one before."""
    return [values[0], *(b for a, b in pairwise(values) if a != b)]


@shell.confirms(
    "comedi", "comedi", part="records", by="comedi_test of Linux 6.1", kind="kernel driver"
)
def record_is_complete() -> str:
    """Each sample of a record is the one of the card's sawtooth: none is lost or repeated."""
    interval_ns, n = 100_000, 20_000
    table = Table(interval_ns, np.zeros((0, 1)), np.zeros((n, 1)), 1)
    with card({"saw": 0}, {"out": 3}) as device:
        able = device.player_capabilities()
        device.load(table)
        device.arm()
        device.start(time.monotonic_ns())
        while (progress := device.progress(time.monotonic_ns())).state is PlayState.PLAYING:
            time.sleep(0.01)
        need(progress == Progress(PlayState.ENDED, 1), f"{progress}")
        found_v = device.recording().positions[:, 0]
    need(len(found_v) == n, f"{len(found_v)} of {n} samples")
    codes = np.rint((found_v + 10) / STEP_V)
    begins = np.flatnonzero(sawtooth(np.arange(PERIOD_US), 1)[:, 0] == codes[0])
    need(
        bool((sawtooth(begins, n) == codes).all(axis=1).any()),
        f"the samples are no sawtooth: {codes[:1000:50]}",
    )
    return f"{n} samples at 10 kHz equal; {able}"


def sawtooth(begins_us: Any, n: int) -> Any:
    """Return what comedi_test samples from each begin on, in its whole numbers: -1 to 1 V."""
    amplitude = 65535 * 1_000_000 // 20_000_000
    at_us = (begins_us[:, None] + 100 * np.arange(n)) % PERIOD_US
    return at_us * 2 * amplitude // PERIOD_US + 65535 // 2 - amplitude


@shell.confirms(
    "comedi", "comedi", part="EBUSY", by="comedi core of Linux 6.1", kind="kernel driver"
)
def other_program_is_named() -> str:
    """While another program plays on the outputs, the card cannot be taken; afterwards it can."""
    with card({}, {"out": 3}) as other:
        try:
            with card({}, {"out": 3}):
                need(False, "two programs drive the card")
        except PortHeldError as error:
            said = str(error)
        need(other.write([0.0], time.monotonic_ns()), "the owner has lost the outputs")
    with card({}, {"out": 3}):
        return said


def stranger_is_refused() -> str:
    """A user outside of the group gets told what is missing."""
    code = (
        "from tests.vm.guest.comedi import card\n"
        "try:\n  card({}, {'out': 3}).__enter__()\nexcept Exception as e: print(e)"
    )
    said = run(f'runuser -u nobody -- env PYTHONPATH=/mnt/host /opt/piezod/bin/python -c "{code}"')
    need("no access" in said, said)
    return said


def wrong_channels_are_refused() -> str:
    """A channel or a range that the card lacks is refused with what it has."""
    said = []
    for options in ({"number": 99}, {"number": 0, "range": (-50.0, 50.0)}):
        plugin = registry.load("comedi")
        made = plugin.options_model.model_validate({"outputs": {"out": options}})
        try:
            plugin.create(made, Wiring((), ("out",)), 1).open()
        except DeviceError as error:
            said.append(str(error))
    need(len(said) == 2, f"only {said}")
    return "; ".join(said)


def output_v(number: int = 3) -> float:
    """Return the voltage at an output, as an input measures it."""
    with card({"in": number}, {}) as device:
        (sample,) = device.read(time.monotonic_ns())
    return float(sample.position_um)


def stage_drives() -> str:
    """Drive a stage at 20 Hz as a service."""
    STAGE.configure()
    STAGE.start()
    return driven(STAGE)


def card_is_removed() -> str:
    """Detach the card in the middle of it, and bring it back: B1, and a person resets the stage."""
    run(f"comedi_config -r {PORT}")
    seen = faulted(STAGE, "B1")
    run("rmmod comedi_test && modprobe comedi_test")
    return f"{seen}; {recovered(STAGE)}"


def stop_leaves_rest() -> str:
    """`systemctl stop` ramps to 0 V, which stays."""
    STAGE.stop()
    found_v = output_v()
    need(abs(found_v) < STEP_V, f"the output is {found_v} V")
    return f"{found_v:.4f} V"
