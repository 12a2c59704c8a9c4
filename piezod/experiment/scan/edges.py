"""Scans that wait for edges: when each sweep was, and what is to be told of the edges."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray

from piezod.devices.player import SeenEdge
from piezod.devices.scan_table import ScanTable
from piezod.experiment.scan.plan import ScanPlan
from piezod.units import NS_PER_S

REGULAR = 1.5
"""A gap this many times as long as the usual one lacks an edge."""
_MOST_TOLD = 10


def sweep_ns(table: ScanTable | ScanPlan, edges: Sequence[SeenEdge]) -> NDArray[np.int64]:
    """Return the time of the first point of each sweep since that of the first one, in ns.

    Args:
        table: The scan, of a device or of the loop.
        edges: The edges that it has seen; sweeps behind the last one are left out.
    """
    first = np.arange(table.sweeps, dtype=np.int64) * table.points
    times = first * table.interval_ns
    if table.edges is None:
        return times
    used = np.array([edge.t_ns for edge in edges if edge.used], np.int64)
    waits = np.array(table.edges.places, np.int64)
    before = np.searchsorted(waits, first, side="right")
    # At each wait, and at the start, a stretch of points begins.
    begin, at_ns = np.insert(waits, 0, 0), np.insert(used, 0, 0)
    before = before[before < at_ns.size]
    found = at_ns[before] + (first[: before.size] - begin[before]) * table.interval_ns
    return np.asarray(found - found[:1])


def place_of(edges: Sequence[SeenEdge]) -> list[int]:
    """Return for each edge how many the scan had used before it: in a stack the present plane."""
    used = np.array([edge.used for edge in edges], np.int64)
    return [int(n) for n in np.cumsum(used) - used]


def edge_notes(edges: Sequence[SeenEdge], planes: int) -> Iterator[str]:
    """Yield a sentence about edges that came too early, and one about those that were missing.

    Args:
        edges: The edges of a scan.
        planes: Number of its planes; 0 if an edge has only started it.
    """
    if not planes:
        if (more := len(edges) - 1) > 0:
            yield f"{_pulses(more)} came during the scan, and moved nothing"
        return
    extra = [
        f"at {edge.t_ns / NS_PER_S:.4f} s {_where(before, planes)}"
        for edge, before in zip(edges, place_of(edges), strict=True)
        if not edge.used
    ]
    if extra:
        n = len(extra)
        yield f"{_pulses(n)} came too early, or too often, and moved nothing: {_listed(extra)}"
    used_s = [edge.t_ns / NS_PER_S for edge in edges if edge.used]
    gaps_s = [later - before for before, later in pairwise(used_s)]
    usual_s = median(gaps_s) if len(gaps_s) > 2 else np.inf
    missing = [
        f"before the end of plane {k + 2}, {gap_s:.4g} s after the one before"
        for k, gap_s in enumerate(gaps_s)
        if gap_s > REGULAR * usual_s
    ]
    if missing:
        n = len(missing)
        yield f"{_pulses(n)} may be missing from a train of {usual_s:.4g} s: {_listed(missing)}"


def _where(before: int, planes: int) -> str:
    return f"in plane {before + 1}" if before < planes else "after the last plane"


def _pulses(n: int) -> str:
    return "1 pulse" if n == 1 else f"{n} pulses"


def _listed(texts: Sequence[str]) -> str:
    more = f", and {len(texts) - _MOST_TOLD} more" if len(texts) > _MOST_TOLD else ""
    return ", ".join(texts[:_MOST_TOLD]) + more
