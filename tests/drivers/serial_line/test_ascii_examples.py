"""The examples of devices that speak in lines are complete."""

import re
from pathlib import Path

import pytest

from piezod.config.devices import DeviceConfig
from piezod.config.fields import Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import parse_yaml
from piezod.devices import registry

PAGE = Path(__file__).parents[3] / "docs" / "serial.md"
EXAMPLES = [
    example
    for example in re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    if example.startswith("driver: ascii")
]


@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_of_the_page_are_valid(example: str) -> None:
    """Each example of the page is valid."""
    device = validate(parse_yaml(example, "example"), DeviceConfig, Context(drivers=registry))

    assert device.driver == "ascii"


def test_there_are_examples() -> None:
    """The page has examples of a positioner, of two channels in a line, and of a stream."""
    assert len(EXAMPLES) == 3
