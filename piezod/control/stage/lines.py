"""The lines of a stage in the cycle: pulses in step with a motion, and edges that it waits for."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from piezod.config.lines import LineConfig, refusal
from piezod.control.reference.edge_clock import EdgeClock
from piezod.control.stage.axis import StageAxis
from piezod.devices.line_levels import LineLevels
from piezod.messages.requests import LinePulses, Wave
from piezod.units import s_to_ns

LOST_CYCLES, LOST_NS = 5, s_to_ns(0.1)
"""A line is lost if it could not be read or set for this many cycles and for this time."""


class _Train:
    """Pulses of a line, over the time of the motion. None is lost: a skipped cycle delays one."""

    def __init__(self, line: int, pulses: LinePulses, begins_ns: int) -> None:
        self.line, self._times = line, pulses.times
        self._begins_ns = sorted(begins_ns + s_to_ns(each) for each in pulses.begins_s)
        self._every_ns, self._high_ns = s_to_ns(pulses.every_s), s_to_ns(pulses.high_s)
        self._sent, self._ends_ns = 0, 0.0

    @property
    def over(self) -> bool:
        """Whether all pulses have begun."""
        return self._sent >= self._times * len(self._begins_ns)

    def is_high(self, t_ns: float, *, was_high: bool) -> bool:
        """Return the level in a cycle, at a time of the motion; `was_high` is the one before."""
        if was_high:  # a cycle of low level ends it
            return t_ns < self._ends_ns
        place = bisect_right(self._begins_ns, t_ns) - 1
        if place < 0:
            return False
        since_ns = t_ns - self._begins_ns[place]
        number = min(since_ns // self._every_ns, self._times - 1)
        if self._sent >= place * self._times + number + 1:
            return False
        self._sent += 1
        self._ends_ns = t_ns - since_ns + number * self._every_ns + self._high_ns
        return True


class _Program(NamedTuple):
    """What the lines do beside a motion."""

    axis: StageAxis  #: One of its axes.
    motion: int  #: Its number.
    started_ns: int  #: Its start.
    trains: Sequence[_Train]
    clock: EdgeClock | None  #: Its time, if it waits for edges.
    edges: int  #: The line with the edges; -1 for none.
    used: frozenset[int]  #: All lines that it uses.


class StageLines:
    """The lines. All methods are real-time safe.

    Args:
        config: The lines by name.
        levels: Their levels, which the devices share.
        period_ns: Period of the loop, in ns.
    """

    def __init__(
        self, config: Mapping[str, LineConfig], levels: LineLevels, period_ns: int
    ) -> None:
        self._config, self._names, self._levels = config, list(config), levels
        self._lost_ns = max(LOST_CYCLES * period_ns, LOST_NS)
        self._known_ns = [0] * len(config)
        self._program: _Program | None = None

    @property
    def busy(self) -> bool:
        """Whether a motion uses them that goes on."""
        return self._program is not None

    @property
    def mask(self) -> int:
        """Bit mask of the lines that are high."""
        return sum(high << i for i, high in enumerate(self._levels.high))

    def refusal(self, request: Wave) -> str:
        """Return why a request cannot use its lines; empty if it can."""
        pulsing = [each.line for each in request.pulses or ()]
        wanted = [(name, True) for name in pulsing]
        wanted += [(request.edges.line, False)] if request.edges else []
        for name, sets in wanted:
            if why := refusal(name, self._config, sets=sets):
                return why
        if twice := {name for name in pulsing if pulsing.count(name) > 1}:
            return f"line {min(twice)} has two lists of pulses: give one, with all of begins_s"
        return ""

    def begin(self, request: Wave, axis: StageAxis, t_ns: int, begins_ns: int) -> EdgeClock | None:
        """Prepare for the next motion; return its time, if it waits for edges.

        Args:
            request: The request of the motion, which is not refused.
            axis: One of its axes, before it moves.
            t_ns: Instant at which the motion starts.
            begins_ns: Time from there to the begin of the waveforms, in ns.
        """
        self._clear()
        edges, clock, place = request.edges, None, -1
        trains = [
            _Train(self._names.index(each.line), each, begins_ns) for each in request.pulses or ()
        ]
        if edges is not None:
            place = self._names.index(edges.line)
            clock = EdgeClock(edges, begins_ns)
        used = frozenset([*(each.line for each in trains), *([place] if clock else ())])
        self._known_ns = [t_ns] * len(self._names)
        self._program = _Program(axis, axis.motion + 1, t_ns, trains, clock, place, used)
        return clock

    def advance(self, t_ns: int, *, running: bool) -> str:
        """Take the levels of a cycle, and set the outputs of the present motion.

        Args:
            t_ns: Instant of the cycle, in ns.
            running: Whether the stage follows motions.

        Returns:
            Why the motion has to end: a line of it is lost. It would pulse, or wait, in vain.
        """
        program, high = self._program, self._levels.high
        if program is None:
            return ""
        if not running or program.axis.motion != program.motion:
            self._clear()
            return ""
        since_ns: float = t_ns - program.started_ns
        clock = program.clock
        if clock is not None:
            clock.advance(t_ns - program.started_ns, high=high[program.edges])
            since_ns = clock.at_ns(since_ns)
        still = clock is not None and clock.waiting
        for train in program.trains:
            was_high = high[train.line]
            high[train.line] = not still and train.is_high(since_ns, was_high=was_high)
        goes_on = any(high[train.line] or not train.over for train in program.trains)
        if clock is not None and clock.ended:
            goes_on = False
        if not (goes_on or program.axis.way_s(t_ns)):
            self._clear()
            return ""
        return self._lost(program, t_ns)

    def _lost(self, program: _Program, t_ns: int) -> str:
        for line in program.used:
            if not self._levels.unknown[line]:
                self._known_ns[line] = t_ns
            elif t_ns - self._known_ns[line] > self._lost_ns:
                name = self._names[line]
                return (
                    f"line {name} of device {self._config[name].device} has given no answer for "
                    f"{self._lost_ns / 1e6:g} ms: the movement that uses it ends; look at the "
                    "device and its cable"
                )
        return ""

    def _clear(self) -> None:
        """Set all outputs low with the next write; nothing waits for an edge any more."""
        if self._program is not None and self._program.clock is not None:
            self._program.clock.ended = True
        self._program = None
        for i, line in enumerate(self._config.values()):
            if line.output is not None:
                self._levels.high[i] = False
