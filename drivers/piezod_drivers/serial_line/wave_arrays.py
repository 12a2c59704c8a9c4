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
"""Share of an output's range by which the recorded output may differ from the table; share of its
motion by which a recorded position may begin elsewhere than the position before."""
_LEAST_UM: Final = 0.5
"""Such a difference is at least this large, in µm."""


def once_of(table: Table) -> FloatArray:
    """Return lead-in and one period, shape (n, outputs)."""
    return np.concatenate((table.lead_in, table.period))


def wave_of(table: Table) -> FloatArray:
    """Return the wave of each output, shape (n, outputs).

    It is the period, or with a lead-in the whole play, because a generator repeats whole waves.
    """
    return first_points(table, table.n_points) if len(table.lead_in) else table.period


def high_points(table: Table) -> list[tuple[int, int]]:
    """Return line and point, both from 1, of each point of the wave at which a line is high."""
    if table.pulses is None:
        return []
    pulses = table.pulses
    if len(table.lead_in):  # the wave is the whole play
        low = np.zeros(len(table.lead_in), pulses.dtype)
        pulses = np.concatenate((low, np.tile(pulses, table.cycles)))
    return [
        (line + 1, int(point) + 1)
        for line in range(8)
        for point in np.flatnonzero(pulses >> line & 1)
    ]


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


def columns_of(columns: Sequence[Sequence[float]]) -> FloatArray:
    """Return columns as an array, shape (n, columns)."""
    return np.array(columns).T


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


def check_beginning(positions_um: FloatArray, first_um: float, before_um: float) -> None:
    """Refuse a record of positions that does not begin at the position before: its scale differs.

    Args:
        positions_um: (n,) recorded positions, in µm.
        first_um: The very first one, in µm.
        before_um: Position before the start, in µm.

    Raises:
        DeviceError: If it begins elsewhere.
    """
    most_um = max(OTHER_UNIT * float(np.ptp(positions_um)), _LEAST_UM)
    if not abs(first_um - before_um) <= most_um:
        raise DeviceError(
            f"the recorded position begins at {first_um:g} µm, the device reported {before_um:g} "
            f"µm before, allowed: a difference of {most_um:.3g} µm; the record has another scale: "
            "do not learn on this device"
        )


def closed_wave_of(table: Table, n_hold: int) -> FloatArray:
    """Return a whole play that may be repeated, shape (n, outputs).

    Behind the play its last value is held. Then it returns to its first value, with steps of the
    size of the largest one in the play.

    Args:
        table: The table.
        n_hold: Number of points for which the last value is held.
    """
    wave = first_points(table, table.n_points)
    first, last = wave[0], wave[-1]
    # The period is closed, and so is its step from the end to the beginning.
    largest = np.abs(np.diff(wave, axis=0)).max(axis=0, initial=0.0)
    way = np.abs(last - first)
    steps = np.divide(way, largest, out=np.zeros_like(way), where=way > 0)
    n_back = int(np.ceil(steps.max(initial=0.0)))
    back = last + (first - last) * (np.arange(1, n_back + 1) / max(n_back, 1))[:, None]
    return np.concatenate((wave, np.tile(last, (n_hold, 1)), np.trunc(back)))
