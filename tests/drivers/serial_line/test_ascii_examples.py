"""The examples of devices that speak in lines are complete."""

import re
from pathlib import Path

import pytest

from piezod.config.devices import DeviceConfig
from piezod.config.fields import Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import parse_yaml
from piezod.devices import registry
from tests.drivers.serial_line.ascii_rig import started
from tests.drivers.serial_line.scripted_line import exchange

PAGE = Path(__file__).parents[3] / "docs" / "serial.md"
EXAMPLES = [
    example
    for example in re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    if example.startswith("driver: ascii")
]


def device_of(example: str) -> DeviceConfig:
    """Return the device of an example."""
    return validate(parse_yaml(example, "example"), DeviceConfig, Context(drivers=registry))


@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_of_the_page_are_valid(example: str) -> None:
    """Each example of the page is valid."""
    assert device_of(example).driver == "ascii"


def test_there_are_examples() -> None:
    """There is one of a positioner, of two channels, a sketch, a MicroPython, and a stream."""
    assert len(EXAMPLES) == 5


def test_example_of_a_sketch_speaks_with_it() -> None:
    """It agrees with what the compiled sketch has sent, on an emulated ATmega2560."""
    (example,) = (each for each in EXAMPLES if "DAQ" in each)
    options = device_of(example).options
    dut, line = started(
        exchange(b"IDN\n", b"General DAQ Device built by Uetke. v.1.2019\n"), **options.model_dump()
    )
    line.then(
        exchange(b"OUT:CH0:100\n", b"100\r\n"),
        exchange(b"IN:CH0\n", b"397\n"),
        exchange(b"OUT:CH0:101\n", b"Command not known\n"),
        exchange(b"OUT:CH0:0\n", b"0\r\n"),
    )
    assert dut.write([100.0], line.now_ns())
    assert dut.read(line.now_ns())[0].position_um == 397.0
    assert not dut.write([101.0], line.now_ns())
    dut.deactivate(line.now_ns())
    line.assert_done()
