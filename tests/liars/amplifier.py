"""An amplifier with a sensor on a pty, which lies when it is told to.

`python -m tests.liars.amplifier PORT TRACE` serves PORT. Lines on its standard input change it:
`lie NAME`, `honest`, `knob VOLTS` (a person sets the output), `mark TEXT`. It knows nothing of
piezod. Last accepted write, voltage on the stage, and read-back are three things; TRACE has each
write with them, each read-back, and each step that it makes by itself.
"""

import os
import re
import select
import sys
import time
import tty
from bisect import bisect_right
from collections import deque
from pathlib import Path
from typing import Final, TextIO

from tests.liars.lies import HONEST, LIES, Lie
from tests.liars.stage import Stage

LOWEST_V, HIGHEST_V = -5.0, 160.0
REMEMBERED: Final = 4000
"""Number of changes of the output that a late read-back remembers."""
OWN_V: Final = 0.01
"""A smaller step by itself is not traced."""
_WRITE: Final = re.compile(r"W (-?\d{1,4}\.\d{1,6})")


class Amplifier:
    """The amplifier behind the port.

    Args:
        trace: Takes the lines of the trace: time in s, kind, last write, voltage on the stage
            before it, and after it, read-back, text.
    """

    def __init__(self, trace: TextIO) -> None:
        self._trace, self._stage = trace, Stage(seed=1)
        self._lie, self._until_s = HONEST, float("inf")
        self._written_v = self._output_v = 0.0
        self._late = deque[tuple[float, float]]()
        self._times_s, self._outputs_v = [0.0], [0.0]
        self._frozen_v = 0.0

    def answer(self, command: str, now_s: float) -> str:
        """Return the reply to a command of the line."""
        self.advance(now_s)
        if command == "ID?":
            return "LIAR A1 SN7"
        if command == "P?":
            return f"P {self._stage.position_um():.4f}"
        if command == "V?":
            shown_v = self._shown_v(now_s)
            self._note(now_s, "read", self._output_v)
            return f"V {shown_v:.3f}"
        asked = _WRITE.fullmatch(command)
        if asked is None or not LOWEST_V <= float(asked[1]) <= HIGHEST_V:
            return "ERR"
        return self._write(float(asked[1]), now_s)

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

    def _write(self, drive_v: float, now_s: float) -> str:
        before_v = self._output_v
        if self._lie.refuses:
            self._note(now_s, "refused", before_v, f"{drive_v:.4f}")
            return "BUSY"
        self._written_v = drive_v
        match self._lie.output:
            case "late":
                self._late.append((now_s + self._lie.value, drive_v))
            case "scaled":
                self._set(self._lie.value * drive_v, now_s)
            case "follows":
                self._set(drive_v, now_s)
        self._note(now_s, "write", before_v)
        return "OK"

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

    def _shown_v(self, now_s: float) -> float:
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

    def _note(self, now_s: float, kind: str, before_v: float, text: str = "") -> None:
        shown_v = self._shown_v(now_s)
        values = (self._written_v, before_v, self._output_v, shown_v)
        numbers = ";".join(f"{value:.4f}" for value in values)
        self._trace.write(f"{now_s:.6f};{kind};{numbers};{text}\n")


def main(port: Path, trace: Path) -> None:
    """Serve until standard input ends."""
    master, slave = os.openpty()
    tty.setraw(slave)
    port.symlink_to(os.ttyname(slave))
    rest = b""
    with trace.open("w", buffering=1) as file:
        amplifier = Amplifier(file)
        print("serving", flush=True)
        while True:
            ready, _, _ = select.select([master, sys.stdin], [], [], 0.005)
            amplifier.advance(time.monotonic())
            if sys.stdin in ready:
                order = sys.stdin.readline()
                if not order:
                    return
                amplifier.tell(order.strip(), time.monotonic())
                print("done", flush=True)
            if master in ready:
                *lines, rest = (rest + os.read(master, 4096)).split(b"\n")
                for line in lines:
                    reply = amplifier.answer(line.decode("latin-1"), time.monotonic())
                    os.write(master, reply.encode() + b"\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
