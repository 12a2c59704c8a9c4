"""Digital lines of a converter card: the kernel's comedi_parport on the PC's parallel port.

What its registers hold is seen, and set, beside comedi: as bytes of `/dev/port`.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from piezod.devices import registry
from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from tests.vm.guest import shell
from tests.vm.guest.comedi import PORT
from tests.vm.guest.shell import need, run

REGISTERS: Final = Path("/dev/port")
ADDRESS: Final = 0x378
DATA, CONTROL = ADDRESS, ADDRESS + 2
INPUTS: Final = 1
"""Subdevice of the port's status register, whose lines are inputs."""
BUSY: Final = 4
"""Its line that the emulated printer pulls low after a strobe, until it is initialised."""
STROBE, INITIALISE = b"\x0d", b"\x00"
PLANES, PIXELS = 5, 8


@contextmanager
def port(inputs: dict[str, Any], outputs: dict[str, Any]) -> Iterator[Any]:
    """Open the port with these lines, and activate it."""
    plugin = registry.load("comedi")
    given = {"port": PORT, "digital_inputs": inputs, "digital_outputs": outputs}
    options = plugin.options_model.model_validate(given)
    device = plugin.create(options, Wiring(tuple(inputs), tuple(outputs)), 1)
    device.open()
    try:
        device.activate(time.monotonic_ns())
        yield device
    finally:
        device.close()


def data() -> int:
    """Return the levels of the outputs, as the register has them."""
    with REGISTERS.open("rb", buffering=0) as registers:
        return os.pread(registers.fileno(), 1, DATA)[0]


def control(value: bytes) -> None:
    """Set the other outputs of the port."""
    with REGISTERS.open("wb", buffering=0) as registers:
        os.pwrite(registers.fileno(), value, CONTROL)


def is_there() -> str:
    """Let comedi have the parallel port, as its first card."""
    run("modprobe -r comedi_test lp ppdev parport_pc comedi")
    run("modprobe comedi comedi_num_legacy_minors=1 && modprobe comedi_parport")
    run(f"comedi_config {PORT} comedi_parport {ADDRESS}")
    with port({}, {"pixel": {"number": 0}}) as device:
        return f"{device.capabilities()}"


@shell.confirms(
    "comedi",
    "comedi",
    part="digital outputs",
    by="comedi_parport of Linux 6.1, the register beside it",
    kind="kernel driver",
)
def pulses_reach_the_register() -> str:
    """Each level of point, line and frame is in the register, is read back, and is alone there."""
    names = ("pixel", "line", "frame")
    outputs = {name: {"number": number} for name, number in zip(names, (0, 3, 7), strict=True)}
    taken_ns = []
    with port({}, outputs) as device:
        for step in range(2 * PLANES * PIXELS):
            pixel, half = divmod(step, 2)
            levels = [half == 0, pixel % PIXELS == 0, pixel < PIXELS]
            begin_ns = time.monotonic_ns()
            need(device.write([float(level) for level in levels], begin_ns), f"{levels} refused")
            read_back = list(device.read_back(begin_ns))
            taken_ns.append(time.monotonic_ns() - begin_ns)
            wanted = levels[0] << 0 | levels[1] << 3 | levels[2] << 7
            need(data() == wanted, f"the register has {data():08b}, wanted {wanted:08b}")
            need(read_back == levels, f"{read_back} was read back, wanted {levels}")
    return f"{len(taken_ns)} cycles equal; one takes {sorted(taken_ns)[len(taken_ns) // 2]} ns here"


@shell.confirms(
    "comedi",
    "comedi",
    part="digital inputs",
    by="comedi_parport of Linux 6.1, the register beside it",
    kind="kernel driver",
)
def edges_are_read() -> str:
    """Each edge at an input is in the next sample, which is valid."""
    with port({"ready": {"number": BUSY, "subdevice": INPUTS}}, {}) as device:
        for high in (True, False) * 20:
            control(INITIALISE if high else STROBE)
            (sample,) = device.read(time.monotonic_ns())
            need(sample.valid and sample.position_um == high, f"{sample}, wanted {high}")
    control(INITIALISE)
    return "40 edges"


def wrong_lines_are_refused() -> str:
    """A line that is missing, and one in a group that has the other direction, are named."""
    said = []
    for inputs, outputs in (
        ({}, {"out": {"number": 9}}),
        ({}, {"out": {"number": 0, "subdevice": INPUTS}}),
        ({"in": {"number": 1}}, {"out": {"number": 0}}),
    ):
        try:
            with port(inputs, outputs):
                pass
        except DeviceError as error:
            said.append(str(error))
    need(len(said) == 3, f"only {said}")
    with port({}, {"out": {"number": 0}}) as device:
        device.write([1.0], time.monotonic_ns())
    need(data() == 1, f"the register has {data():08b} after an input was there")
    return "; ".join(said)
