"""Options of a device that speaks in lines of text."""

from typing import Self

from pydantic import model_validator

from piezod.config.fields import raise_rules
from piezod_drivers.serial_line.ascii_line.fields import AsciiFields
from piezod_drivers.serial_line.ascii_line.rules import broken_rules


class AsciiOptions(AsciiFields):
    """Options of a device that speaks in lines of text."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        raise_rules(broken_rules(self))
        return self
