"""Tables, waves and records as arrays; imported only to load or to read them.

What brings a stage down must work without numpy.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.player import Table

FloatArray: TypeAlias = npt.NDArray[np.float64]


def n_points_of(table: Table) -> int:
    """Return the number of points of a whole play."""
    return len(table.lead_in) + len(table.period) * table.cycles


def wave_of(table: Table) -> FloatArray:
    """Return the wave of each output, shape (n, outputs).

    It is the period, or with a lead-in the whole play, because a generator repeats whole waves.
    """
    return first_points(table, n_points_of(table)) if len(table.lead_in) else table.period


def table_of(table: Table, waves: Sequence[Sequence[float]]) -> Table:
    """Return a table with the values of its waves as the controller holds them."""
    held = np.array(waves).T
    n_lead_in = len(table.lead_in)
    period = held[n_lead_in : n_lead_in + len(table.period)]
    return table._replace(lead_in=held[:n_lead_in], period=period)


def first_points(table: Table, n_points: int) -> FloatArray:
    """Return the first points of a play, shape (n_points, outputs)."""
    after = np.arange(max(n_points - len(table.lead_in), 0)) % len(table.period)
    return np.concatenate((table.lead_in[:n_points], table.period[after]))


def rows_of(rows: Sequence[Sequence[float]]) -> FloatArray:
    """Return rows as an array."""
    return np.array(rows)
