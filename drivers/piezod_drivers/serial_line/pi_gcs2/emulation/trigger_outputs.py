"""The digital outputs of the emulated controller, by the wave generators or by a position."""

from collections.abc import Sequence
from typing import Final

from piezod_drivers.serial_line.gcs.emulator import GcsRefusal
from piezod_drivers.serial_line.pi_gcs2.emulation.arguments import number, whole

N_OUTPUTS: Final = 4
_MODE, _BY_DISTANCE, _BY_GENERATOR = 3, 0, 4
_STEP, _AXIS, _START, _STOP = 1, 2, 8, 9
_WORDS, _WRONG = 24, 17
MOST_STEPS: Final = 1_000_000_000
"""Steps that no axis goes: it must come from before the start threshold first."""


class TriggerOutputs:
    """Outputs, from 1, each high at some points of a wave.

    Attributes:
        pulses: Number of rising edges of each output.
    """

    def __init__(self) -> None:
        self._high: list[set[int]] = [set() for _ in range(N_OUTPUTS)]
        self._settings = [dict[int, float]() for _ in range(N_OUTPUTS)]
        self._passed = [-1] * N_OUTPUTS  # steps behind the start threshold
        self._state = [False] * N_OUTPUTS
        self.pulses = [0] * N_OUTPUTS

    def at(self, point: int) -> None:
        """Show a point of the wave, from 1; 0 for none."""
        for i, high in enumerate(self._high):
            state = self._settings[i].get(_MODE) == _BY_GENERATOR and point in high
            self.pulses[i] += state and not self._state[i]
            self._state[i] = state

    def measured(self, positions_um: Sequence[float]) -> None:
        """Pulse at the positions of the axes: once for each step from start to stop threshold."""
        for i, given in enumerate(self._settings):
            if given.get(_MODE) != _BY_DISTANCE or not given.get(_STEP):
                continue
            up = 1.0 if given[_STOP] > given[_START] else -1.0
            way_um = up * (positions_um[int(given[_AXIS]) - 1] - given[_START])
            steps = int(way_um // given[_STEP])
            if way_um < 0.0:
                self._passed[i] = -1
            elif steps > self._passed[i] and way_um <= abs(given[_STOP] - given[_START]):
                self.pulses[i] += 1
                self._passed[i] = steps

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
            (self._high[i].add if switch else self._high[i].discard)(int(point))
        return b""

    def configure(self, text: str) -> bytes:
        """`CTO output parameter value …`."""
        for i, parameter, value in _triples(text):
            self._settings[i][parameter] = value
            self._passed[i] = MOST_STEPS
        return b""


def _triples(text: str) -> list[tuple[int, int, float]]:
    """Return index, parameter and value of each triple."""
    words = text.split()
    if not words or len(words) % 3 or len(words) > 31:
        raise GcsRefusal(_WORDS)
    outputs, parameters = ([whole(word) for word in words[i::3]] for i in (0, 1))
    triples = list(zip(outputs, parameters, map(number, words[2::3]), strict=True))
    if any(not 1 <= output <= N_OUTPUTS for output, _, _ in triples):
        raise GcsRefusal(_WRONG)
    return [(output - 1, parameter, value) for output, parameter, value in triples]
