"""Tables and records of a LabJack's stream as arrays; imported only to load or to read them.

What brings a stage down must work without numpy.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.player import Table
from piezod.errors import DeviceError
from piezod_drivers.modbus.profiles.labjack_stream import LOST, InputScale
from piezod_drivers.modbus.stream_setup import dio_word

FloatArray: TypeAlias = npt.NDArray[np.float64]


def columns_of(table: Table) -> list[list[float]]:
    """Return the values of each output: lead-in, then period."""
    values = np.concatenate((table.lead_in, table.period))
    return [[float(value) for value in column] for column in values.T]


def words_of(table: Table) -> tuple[list[int], int]:
    """Return the words of the digital outputs, low in the lead-in, and the bits of the used ones.

    Without pulses there are no words.
    """
    if table.pulses is None or not table.pulses.any():
        return [], 0
    mask = int(np.bitwise_or.reduce(table.pulses))
    states = [0] * len(table.lead_in) + table.pulses.tolist()
    return [dio_word(state, mask) for state in states], mask


def quantised(table: Table, highest_v: Sequence[float], n_steps: int) -> Table:
    """Return a table as converters with this number of steps give it.

    Args:
        table: The table, in V.
        highest_v: Highest voltage of each output; the lowest one is 0 V.
        n_steps: Number of steps.
    """
    step_v = np.asarray(highest_v) / n_steps
    return table._replace(
        lead_in=np.round(table.lead_in / step_v) * step_v,
        period=np.round(table.period / step_v) * step_v,
    )


def volts_of(codes: npt.NDArray[np.uint16], scales: Sequence[InputScale]) -> FloatArray:
    """Return the voltages of scans, in V, shape (k, inputs); NaN for a code at an end.

    The converter is saturated there, or the scan stands for lost ones.

    Args:
        codes: Codes, shape (k, inputs).
        scales: Scale of each input.
    """
    found = np.empty(codes.shape)
    for i, (center, above, below, offset) in enumerate(scales):
        column = codes[:, i].astype(float)
        found[:, i] = offset + (column - center) * np.where(column >= center, above, below)
        found[(codes[:, i] == 0) | (codes[:, i] == LOST), i] = np.nan
    return found


def positions_of(
    kept: Sequence[tuple[bytes, int]], n_scans: int, scales: Sequence[InputScale]
) -> FloatArray:
    """Return the voltages of a record, in V, shape (n_scans, inputs); NaN for lost scans.

    Args:
        kept: Samples of each packet, and the number of lost scans for which one scan of it stands.
        n_scans: Number of scans of the whole record.
        scales: Scale of each input.

    Raises:
        DeviceError: If scans are missing that the device does not report as lost.
    """
    n_inputs, n_found, gap_at = len(scales), 0, -1
    parts = [np.empty((0, n_inputs))]
    for samples, n_lost in kept:
        codes = np.frombuffer(samples, ">u2").reshape(-1, n_inputs)
        if n_lost:
            marked = (codes == LOST).all(axis=1)
            if not marked.any():
                raise DeviceError(f"{n_lost} scans are lost, and their place is not marked")
            place = int(np.argmax(marked))
            gap_at = n_found + place if gap_at < 0 else gap_at
            gap = np.full((n_lost, n_inputs), LOST, codes.dtype)
            codes = np.concatenate((codes[:place], gap, codes[place + 1 :]))
        n_found += len(codes)
        parts.append(volts_of(codes, scales))
    found = np.concatenate(parts)
    if n_found == n_scans:
        return found
    if gap_at < 0:
        raise DeviceError(f"the record has {n_found} scans, expected {n_scans}")
    # The number of lost scans is wrong, so the time of all later ones is unknown.
    whole = np.full((n_scans, n_inputs), np.nan)
    whole[:gap_at] = found[:gap_at]
    return whole


def nothing(n_samples: int) -> FloatArray:
    """Return a record without channels, shape (n_samples, 0)."""
    return np.empty((n_samples, 0))
