"""An amplifier with an output of its own: what is written, on the stage and read back may differ.

Every write is acknowledged as by an amplifier that works. The physics of the device follow the
output, so that a sensor shows what is on the stage.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from enum import StrEnum
from math import exp, isfinite, nan
from typing import Final, NamedTuple

from piezod.devices.interface import Capabilities, Identity, KnowsTruth, Sample
from piezod.testing.faulty import SensorAmplifier
from piezod.units import NS_PER_S


class OutputKind(StrEnum):
    """What an output or its read-back does, and the meaning of the value of a fault."""

    STUCK = "output stuck"
    """The output stays. At the end it takes the last write."""
    SCALED = "output scaled"
    """The output is the write times the value."""
    LATE = "output late"
    """The output follows each write after the value, in s."""
    SLOW = "output slow"
    """The output follows the writes with this time constant, in s."""
    OFF = "output off"
    """The output falls to 0 V. At the end it takes the last write."""
    ELSEWHERE = "output off, back elsewhere"
    """The output falls to 0 V. At the end it takes the value, in V, until the next write."""
    FROZEN_READ_BACK = "read-back frozen"
    """The read-back stays."""
    FALSE_READ_BACK = "read-back false"
    """The read-back is the value, in V."""
    SHIFTED_READ_BACK = "read-back shifted"
    """The value is added to the read-back, in V."""
    SCALED_READ_BACK = "read-back scaled"
    """The read-back is the output times the value."""
    LATE_READ_BACK = "read-back late"
    """The read-back is that of the value before, in s."""


OF_READ_BACK: Final = frozenset(kind for kind in OutputKind if kind.startswith("read-back"))
OFF_KINDS: Final = frozenset({OutputKind.OFF, OutputKind.ELSEWHERE})


class OutputFault(NamedTuple):
    """One fault of an output or of its read-back."""

    kind: OutputKind  #: What it does.
    start_ns: int  #: Its first instant.
    end_ns: float  #: Its end, exclusive.
    value: float = 0.0  #: Its size, see `OutputKind`.


class OwnOutput:
    """Implements `Sensor`, `Amplifier` and `KnowsTruth` over a device with one output.

    Of two faults of the output that are present, the newer one counts; of the read-back likewise.
    Faults may be added at any time. `steps_v` has the largest step that the output has made
    without a write, by kind, in V.
    """

    def __init__(self, inner: SensorAmplifier, range_v: tuple[float, float]) -> None:
        self._inner, self._range_v = inner, range_v
        self.faults: list[OutputFault] = []
        self.steps_v: dict[OutputKind, float] = {}
        self._asked_v = self._set_v = 0.0  # the last write; what the device was told
        self._fault: OutputFault | None = None
        self._settled_ns, self._active = 0, False
        self._asked: deque[tuple[int, float]] = deque()  # since a late output has begun
        self._points = deque[tuple[int, float]]()  # of a play, with their instants
        self.played_v = nan
        """The last point of a play since the last write, in V; NaN if there is none."""
        self._shown_fault: OutputFault | None = None
        self._shown: deque[tuple[int, float]] = deque()  # since a late read-back has begun

    def open(self) -> Identity:
        """Open the device."""
        return self._inner.open()

    def capabilities(self) -> Capabilities:
        """Return the capabilities of the device."""
        return self._inner.capabilities()

    def activate(self, now_ns: int) -> None:
        """Activate the device."""
        self._inner.activate(now_ns)
        self._active = True

    def deactivate(self, now_ns: int) -> None:
        """Bring the output to rest."""
        self._inner.deactivate(now_ns)
        self._active, self._asked_v, self._set_v = False, 0.0, 0.0

    def close(self) -> None:
        """Close the device."""
        self._inner.close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take a sample."""
        self._settle(now_ns)
        return self._inner.read(now_ns)

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Return the true displacement, in µm."""
        assert isinstance(self._inner, KnowsTruth)
        return self._inner.true_position_um(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Command a voltage; acknowledge it, whatever the output does."""
        self._settle(now_ns)
        (asked_v,) = drive_v
        if self._fault is None:
            if not self._inner.write(drive_v, now_ns):
                return False
            self._set_v = asked_v
        elif not (self._active and isfinite(asked_v)):
            return False
        self._take(asked_v, now_ns)
        self.played_v = nan
        return True

    def _take(self, asked_v: float, now_ns: int) -> None:
        self._asked_v = asked_v
        self._asked.append((now_ns, asked_v))
        self._command(self._target_v(now_ns), now_ns)

    def play(self, points: Iterable[tuple[int, float]]) -> None:
        """Play voltages by its own clock; none stops the play, and the output keeps its voltage.

        Each point has its instant, in ns, and its voltage, in V.
        """
        self._points = deque(points)

    def plays(self, now_ns: int) -> bool:
        """Return whether a play goes on."""
        self._settle(now_ns)
        return bool(self._points)

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back, in V; a fault may change it."""
        output_v = self.output_v(now_ns)
        fault = self._present(now_ns, of_read_back=True)
        if fault != self._shown_fault:
            self._shown_fault = fault
            self._shown.clear()
        self._shown.append((now_ns, output_v))
        if fault is None:
            self._shown.clear()
            return [output_v]
        match fault.kind:
            case OutputKind.FROZEN_READ_BACK:
                return [self._shown[0][1]]
            case OutputKind.FALSE_READ_BACK:
                return [fault.value]
            case OutputKind.SHIFTED_READ_BACK:
                return [output_v + fault.value]
            case OutputKind.SCALED_READ_BACK:
                return [output_v * fault.value]
            case _:
                return [_delayed(self._shown, now_ns - int(fault.value * NS_PER_S))]

    def output_v(self, now_ns: int) -> float:
        """Return the voltage on the stage, in V."""
        self._settle(now_ns)
        (output_v,) = self._inner.read_back(now_ns)
        return output_v

    @property
    def largest_step_v(self) -> float:
        """Largest step that the output has made without a write, in V."""
        return max(self.steps_v.values(), default=0.0)

    @property
    def follows_by_gain(self) -> bool:
        """Whether the output follows each write at once, with a false gain."""
        return self._fault is not None and self._fault.kind is OutputKind.SCALED

    def _present(self, now_ns: int, *, of_read_back: bool) -> OutputFault | None:
        for kind, start_ns, end_ns, value in reversed(self.faults):
            if start_ns <= now_ns < end_ns and (kind in OF_READ_BACK) is of_read_back:
                return OutputFault(kind, start_ns, end_ns, value)
        return None

    def _settle(self, now_ns: int) -> None:
        """Let the output do by itself what it does up to now, and play what is due."""
        while self._points and self._points[0][0] <= now_ns:
            due_ns, self.played_v = self._points.popleft()
            self._settle_fault(max(due_ns, self._settled_ns))
            self._take(self.played_v, self._settled_ns)
        self._settle_fault(now_ns)

    def _settle_fault(self, now_ns: int) -> None:
        fault, before = self._present(now_ns, of_read_back=False), self._fault
        if fault != before:
            if before is not None and before.kind is OutputKind.ELSEWHERE and self._active:
                self._asked_v = before.value
            self._fault = fault
            self._asked.clear()
            self._asked.append((now_ns, self._set_v))
        cause = fault or before
        if cause is not None and self._active:
            step_v = self._command(self._target_v(now_ns), now_ns)
            self.steps_v[cause.kind] = max(self.steps_v.get(cause.kind, 0.0), step_v)
        self._settled_ns = now_ns

    def _target_v(self, now_ns: int) -> float:
        """Return the voltage that the output should have now, in V."""
        if self._fault is None:
            self._asked.clear()
            return self._asked_v
        kind, _, _, value = self._fault
        if kind is OutputKind.STUCK:
            return self._set_v
        if kind in OFF_KINDS:
            return 0.0
        if kind is OutputKind.SCALED:
            target_v = self._asked_v * value
        elif kind is OutputKind.LATE:
            target_v = _delayed(self._asked, now_ns - int(value * NS_PER_S))
        else:
            passed = (now_ns - self._settled_ns) / NS_PER_S / value
            target_v = self._set_v + (self._asked_v - self._set_v) * (1.0 - exp(-passed))
        return min(max(target_v, self._range_v[0]), self._range_v[1])

    def _command(self, target_v: float, now_ns: int) -> float:
        """Set the output; return its step, in V."""
        step_v = abs(target_v - self._set_v)
        if step_v and self._inner.write([target_v], now_ns):
            self._set_v = target_v
        return step_v


def _delayed(past: deque[tuple[int, float]], t_ns: int) -> float:
    """Return the newest value up to an instant, or the oldest one; forget those before it."""
    while len(past) > 1 and past[1][0] <= t_ns:
        past.popleft()
    return past[0][1]
