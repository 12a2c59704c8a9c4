"""Options of a device that speaks in lines of text."""

from collections.abc import Iterator

from piezod.config.fields import BrokenRule
from piezod_drivers.serial_line.ascii_line.fields import AsciiFields
from piezod_drivers.serial_line.ascii_line.rules import broken_rules


class AsciiOptions(AsciiFields):
    """Options of a device that speaks in lines of text."""

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        yield from broken_rules(self)
