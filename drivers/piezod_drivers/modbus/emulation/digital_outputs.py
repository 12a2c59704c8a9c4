"""The lines FIO0 to FIO7 of an emulated LabJack, as outputs; it counts their pulses."""

from piezod_drivers.modbus.emulation.unit import EmulatedUnit
from piezod_drivers.modbus.profiles.labjack_stream import DIO_DIRECTION, DIO_STATE

N_LINES = 8


class DigitalOutputs:
    """The lines, each with a bit; the bits of the high byte of a word leave lines alone.

    Attributes:
        state: Bits of the lines that are high.
        pulses: Number of rising edges of each line.
    """

    def __init__(self) -> None:
        self.state = self._direction = 0
        self.pulses = [0] * N_LINES

    def set(self, word: float, at_ns: int | None = None) -> None:
        """Set lines; only those that are outputs show it."""
        del at_ns  # as a converter has it
        state = _with(self.state, int(word))
        rising = state & ~self.state & self._direction
        for line in range(N_LINES):
            self.pulses[line] += rising >> line & 1
        self.state = state

    def add_to(self, unit: EmulatedUnit) -> None:
        """Add the registers."""
        unit.add("holding", DIO_STATE, "uint16", lambda: self.state, self.set)
        unit.add("holding", DIO_DIRECTION, "uint16", lambda: self._direction, self._turn)

    def _turn(self, word: float) -> None:
        self._direction = _with(self._direction, int(word))


def _with(bits: int, word: int) -> int:
    alone = word >> 8
    return bits & alone | word & ~alone & 0xFF
