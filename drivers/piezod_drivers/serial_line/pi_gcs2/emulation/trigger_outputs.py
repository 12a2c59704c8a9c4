"""The digital outputs of the emulated controller, which follow the wave generators."""

from typing import Final

from piezod_drivers.serial_line.gcs.emulator import GcsRefusal
from piezod_drivers.serial_line.pi_gcs2.emulation.arguments import whole

N_OUTPUTS: Final = 4
_MODE, _BY_GENERATOR = 3, 4
_WORDS, _WRONG = 24, 17


class TriggerOutputs:
    """Outputs, from 1, each high at some points of a wave.

    Attributes:
        pulses: Number of rising edges of each output.
    """

    def __init__(self) -> None:
        self._high: list[set[int]] = [set() for _ in range(N_OUTPUTS)]
        self._follows = [False] * N_OUTPUTS
        self._state = [False] * N_OUTPUTS
        self.pulses = [0] * N_OUTPUTS

    def at(self, point: int) -> None:
        """Show a point of the wave, from 1; 0 for none."""
        for i, high in enumerate(self._high):
            state = self._follows[i] and point in high
            self.pulses[i] += state and not self._state[i]
            self._state[i] = state

    def clear(self, _text: str) -> bytes:
        """`TWC`: all points are low."""
        for high in self._high:
            high.clear()
        return b""

    def set_points(self, text: str) -> bytes:
        """`TWS output point switch …`."""
        for i, point, switch in _triples(text):
            if point < 1 or switch not in {0, 1}:
                raise GcsRefusal(_WRONG)
            (self._high[i].add if switch else self._high[i].discard)(point)
        return b""

    def configure(self, text: str) -> bytes:
        """`CTO output parameter value …`."""
        for i, parameter, value in _triples(text):
            if parameter == _MODE:
                self._follows[i] = value == _BY_GENERATOR
        return b""


def _triples(text: str) -> list[tuple[int, int, int]]:
    """Return index, parameter and value of each triple."""
    words = text.split()
    if not words or len(words) % 3 or len(words) > 31:
        raise GcsRefusal(_WORDS)
    numbers = [whole(word) for word in words]
    triples = list(zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True))
    if any(not 1 <= output <= N_OUTPUTS for output, _, _ in triples):
        raise GcsRefusal(_WRONG)
    return [(output - 1, parameter, value) for output, parameter, value in triples]
