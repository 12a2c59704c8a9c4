"""What the lines of the loop do in a scan: pulses in step with it, and edges for which it waits."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezod.config.lines import LineConfig, refusal
from piezod.config.scan import AnyScan
from piezod.control.reference.edge_clock import EdgeClock
from piezod.devices.player import SeenEdge
from piezod.errors import DataError
from piezod.experiment.scan.plan import ScanPlan
from piezod.hysteresis.memory import FloatArray
from piezod.messages.requests import LineEdges, LinePulses
from piezod.units import NS_PER_S


class PartLines(NamedTuple):
    """What lines do in a part of a scan, in s since the begin of its waveforms."""

    pulses: tuple[LinePulses, ...] = ()
    edges: LineEdges | None = None  #: The edges for which it waits; None for none.


def check_lines(scan: AnyScan, lines: Mapping[str, Any], users: Collection[str] = ()) -> None:
    """Refuse a scan whose lines the stage does not have.

    Args:
        scan: The scan.
        lines: The lines of the stage, as its configuration has them, by name.
        users: Names of its user axes, with which no line is in step.

    Raises:
        DataError: If there is one; the text has a line for each problem.
    """
    known = {name: LineConfig.model_validate(line) for name, line in lines.items()}
    wanted = [*_pulse_names(scan), *([("edge", scan.edge)] if scan.edge else ())]
    problems = [
        f"{span.axis} is a user axis: lines are in step with the axes of `axes:` only"
        for span in scan.spans
        if wanted and span.axis in users
    ]
    for key, name in wanted:
        if why := refusal(name, known, sets=key != "edge"):
            problems.append(f"{key}: {why}")
    if problems:
        raise DataError("\n".join(problems))


def _pulse_names(scan: AnyScan) -> list[tuple[str, str]]:
    given = scan.pulses.given.items()
    return [(f"pulses.{key}", name) for key, name in given if isinstance(name, str)]


def lines_of(scan: AnyScan, plan: ScanPlan, sweeps: range, zero_s: float) -> PartLines:
    """Return what lines do in some sweeps.

    A cycle comes a little earlier or later than planned: the one that is nearest to the begin of a
    pixel begins its pulse.

    Args:
        scan: The scan.
        plan: Its plan.
        sweeps: Indices of the sweeps.
        zero_s: Time of point 0 of all sweeps, in s since the begin of the waveforms.
    """
    interval_s = plan.interval_ns / NS_PER_S
    zero_s -= 0.5 * interval_s
    starts_s = [zero_s + k * plan.points * interval_s for k in sweeps]
    pulses = [
        LinePulses(
            line=name,
            begins_s=tuple(starts_s[:1] if key == "pulses.frame" else starts_s),
            every_s=plan.per_pixel * interval_s,
            times=plan.pixels if key == "pulses.pixel" else 1,
            high_s=plan.high * interval_s,
        )
        for key, name in _pulse_names(scan)
        if key != "pulses.frame" or not sweeps.start
    ]
    edges = None
    if plan.edges is not None and scan.edge is not None and not sweeps.start:
        edges = LineEdges(
            line=scan.edge,
            first_s=zero_s + plan.edges.first * interval_s,
            every_s=plan.edges.every * interval_s,
            times=plan.edges.times,
            within_s=plan.edges.within_ns / NS_PER_S,
        )
    return PartLines(tuple(pulses), edges)


class Followed(NamedTuple):
    """The time of a motion in cycles, and the edges that it has seen."""

    t_s: FloatArray  #: (n,) time of the motion, in s; it stands still during a wait.
    edges: tuple[SeenEdge, ...] = ()  #: Times are since the begin of the waveforms, in ns.
    ended: bool = False  #: Whether an edge has not come.


def followed(edges: LineEdges | None, since_ns: NDArray[np.int64], high: Any) -> Followed:
    """Return what the loop has made of the levels of a line.

    Args:
        edges: The edges for which it waited; None for none.
        since_ns: (n,) time of each cycle since the begin of the waveforms, in ns.
        high: (n,) level of the line in each cycle.
    """
    if edges is None:
        return Followed(since_ns / NS_PER_S)
    clock, t_s, seen = EdgeClock(edges, 0), [0.0], list[SeenEdge]()
    for t_ns, level in zip(since_ns[1:].tolist(), high[1:].tolist(), strict=True):
        used = clock.advance(t_ns, high=bool(level))
        if used is not None:
            seen.append(SeenEdge(t_ns, used))
        t_s.append(clock.at_ns(t_ns) / NS_PER_S)
    return Followed(np.array(t_s), tuple(seen), clock.ended)


def pulse_notes(scan: AnyScan, plan: ScanPlan, counted: Mapping[str, int]) -> Iterator[str]:
    """Yield how many pulses each line has put out.

    Args:
        scan: The scan.
        plan: Its plan.
        counted: Rising edges of lines in the records of the cycles, by name.
    """
    of_key = {"pulses.pixel": plan.pixels * plan.sweeps, "pulses.line": plan.sweeps}
    for key, name in _pulse_names(scan):
        yield f"line {name}: {counted.get(name, 0)} of {of_key.get(key, 1)} pulses"


def count_pulses(masks: NDArray[np.int64], names: Collection[str]) -> dict[str, int]:
    """Return the rising edges of each line in the bit masks of successive cycles, by name."""
    rising = masks[1:] & ~masks[:-1]
    return {name: int(np.count_nonzero(rising >> i & 1)) for i, name in enumerate(names)}
