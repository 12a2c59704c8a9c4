"""Tables, waves and records as arrays; imported only to load or to read them.

What brings a stage down must work without numpy.
"""

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.player import Table
from piezod.errors import DeviceError

FloatArray: TypeAlias = npt.NDArray[np.float64]

OTHER_UNIT: Final = 0.2
"""Share of an output's range by which the recorded output may differ from the table."""


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


def check_followed(differences: FloatArray, ranges: Sequence[tuple[float, float]]) -> None:
    """Refuse a record of other outputs than those of the table: their unit may be another one.

    Args:
        differences: (n, outputs) recorded outputs minus those of the table.
        ranges: Lowest and highest value of each output.

    Raises:
        DeviceError: If an output has not followed its table.
    """
    for i, (low, high) in enumerate(ranges):
        most = float(np.abs(differences[:, i]).max(initial=0.0))
        if not most <= OTHER_UNIT * (high - low):
            raise DeviceError(
                f"the recorded value of output {i} differs from the table by {most:.1f}, allowed: "
                f"{OTHER_UNIT * (high - low):g}; the unit of its waves may be another one: do not "
                "play on this controller"
            )
