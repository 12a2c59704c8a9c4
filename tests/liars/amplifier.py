"""An amplifier with a sensor, which lies when it is told to.

It knows nothing of piezod. Last accepted write, voltage on the stage, and read-back are three
things; its trace has each write with them, each read-back, each point of a table that it plays, and
each step that it makes by itself. `lines.py` and `controller.py` speak for it.
"""

from bisect import bisect_right
from collections import deque
from typing import Final, TextIO

from tests.liars.lies import HONEST, LIES, Lie
from tests.liars.stage import Stage

LOWEST_V, HIGHEST_V = -5.0, 160.0
REMEMBERED: Final = 4000
"""Number of changes of the output that a late read-back remembers."""
OWN_V: Final = 0.01
"""A smaller step by itself is not traced."""


class Amplifier:
    """The amplifier behind a port.

    Args:
        trace: Takes the lines of the trace: time in s, kind, last write, voltage on the stage
            before it, and after it, read-back, position, text.
    """

    def __init__(self, trace: TextIO) -> None:
        self._trace, self._stage = trace, Stage(seed=1)
        self._lie, self._until_s = HONEST, float("inf")
        self._written_v = self._output_v = 0.0
        self._late = deque[tuple[float, float]]()
        self._times_s, self._outputs_v = [0.0], [0.0]
        self._frozen_v = 0.0

    @property
    def refuses(self) -> bool:
        """Whether it refuses what would change its output."""
        return self._lie.refuses

    def position_um(self) -> float:
        """Return where the stage is, in µm, without a line in the trace."""
        return self._stage.position_um()

    def sense_um(self, now_s: float) -> float:
        """Return what the sensor shows, in µm."""
        self._note(now_s, "sense", self._output_v)
        return self.position_um()

    def read_back_v(self, now_s: float) -> float:
        """Return what is read back, in V."""
        self._note(now_s, "read", self._output_v)
        return self.shown_v(now_s)

    def shown_v(self, now_s: float) -> float:
        """Return what is measured of the output, in V, without a line in the trace."""
        match self._lie.read_back:
            case "stuck":
                return self._frozen_v
            case "false":
                return self._lie.value
            case "scaled":
                return self._lie.value * self._output_v
            case "late":
                at = bisect_right(self._times_s, now_s - self._lie.value) - 1
                return self._outputs_v[max(at, 0)]
        return self._output_v

    def write(self, drive_v: float, now_s: float) -> bool:
        """Take a voltage, in V; return whether it is accepted."""
        if self._lie.refuses or not LOWEST_V <= drive_v <= HIGHEST_V:
            self._note(now_s, "refused", self._output_v, f"{drive_v:.4f}")
            return False
        self._take(drive_v, now_s, "write")
        return True

    def play(self, drive_v: float, due_s: float, *, starts: bool) -> None:
        """Take a point of a table that it plays, in V; the first one starts the play."""
        self._take(drive_v, due_s, "start" if starts else "play")

    def note(self, now_s: float, kind: str) -> None:
        """Note in the trace what is done with it."""
        self._note(now_s, kind, self._output_v)

    def tell(self, order: str, now_s: float) -> None:
        """Obey the person who tests."""
        self.advance(now_s)
        verb, _, what = order.partition(" ")
        if verb == "lie":
            self._begin(LIES[what], now_s)
        elif verb == "honest":
            self._end(now_s)
        elif verb == "knob":
            self._written_v = float(what)
            self._by_itself(self._written_v, now_s, "knob")
        self._note(now_s, "mark", self._output_v, order)

    def advance(self, now_s: float) -> None:
        """Do what is due by itself."""
        while self._late and self._late[0][0] <= now_s:
            due_s, drive_v = self._late.popleft()
            before_v = self._output_v
            self._set(drive_v, due_s)
            self._note(now_s, "late", before_v)
        if now_s >= self._until_s:
            self._end(now_s)

    def _take(self, drive_v: float, now_s: float, kind: str) -> None:
        before_v, self._written_v = self._output_v, drive_v
        match self._lie.output:
            case "late":
                self._late.append((now_s + self._lie.value, drive_v))
            case "scaled":
                self._set(self._lie.value * drive_v, now_s)
            case "follows":
                self._set(drive_v, now_s)
        self._note(now_s, kind, before_v)

    def _begin(self, lie: Lie, now_s: float) -> None:
        self._frozen_v = self._output_v
        self._lie, self._until_s = lie, now_s + lie.lasts_s
        if lie.output == "off":
            self._by_itself(0.0, now_s, "fall")
        elif lie.output == "scaled":
            self._by_itself(lie.value * self._written_v, now_s, "scale")

    def _end(self, now_s: float) -> None:
        ended, self._lie, self._until_s = self._lie, HONEST, float("inf")
        self._late.clear()
        if ended.back_at_zero:
            return
        if ended.output != "follows":
            self._by_itself(
                self._written_v, now_s, "return" if ended.output == "off" else "release"
            )

    def _by_itself(self, drive_v: float, now_s: float, why: str) -> None:
        before_v = self._output_v
        self._set(drive_v, now_s)
        if abs(before_v - drive_v) > OWN_V:
            self._note(now_s, "own", before_v, why)

    def _set(self, drive_v: float, at_s: float) -> None:
        self._output_v = drive_v
        self._stage.drive(drive_v)
        self._times_s.append(at_s)
        self._outputs_v.append(drive_v)
        del self._times_s[:-REMEMBERED], self._outputs_v[:-REMEMBERED]

    def _note(self, now_s: float, kind: str, before_v: float, text: str = "") -> None:
        shown_v = self.shown_v(now_s)
        position_um = self._stage.position_um()
        values = (self._written_v, before_v, self._output_v, shown_v, position_um)
        numbers = ";".join(f"{value:.4f}" for value in values)
        self._trace.write(f"{now_s:.6f};{kind};{numbers};{text}\n")
