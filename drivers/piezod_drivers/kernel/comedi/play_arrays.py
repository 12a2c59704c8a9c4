"""Tables as codes of a card, and its samples as values: with numpy, outside of the loop."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.player import Table
from piezod_drivers.kernel.comedi.codec import Converter, Polynomial

FloatArray: TypeAlias = npt.NDArray[np.float64]


def codes_of(values_v: FloatArray, converters: Sequence[Converter]) -> FloatArray:
    """Return the code of each value, shape (n, outputs)."""
    columns = [
        np.clip(np.rint(_evaluated(one.from_v, values_v[:, i])), 0, one.most)
        for i, one in enumerate(converters)
    ]
    return np.stack(columns, axis=1)


def quantised(table: Table, converters: Sequence[Converter]) -> Table:
    """Return a table with the voltages of the codes that the card outputs."""
    return table._replace(
        lead_in=_volts(codes_of(table.lead_in, converters), converters),
        period=_volts(codes_of(table.period, converters), converters),
    )


def bytes_of(values_v: FloatArray, converters: Sequence[Converter], width: int) -> bytes:
    """Return values as the card takes them: codes of `width` bytes, scan by scan."""
    return codes_of(values_v, converters).astype(f"u{width}").tobytes()


def samples_of(data: bytes, converters: Sequence[Converter], width: int) -> FloatArray:
    """Return samples, shape (n, channels), in V; NaN at an end of a range."""
    codes = np.frombuffer(data, f"u{width}").astype(np.float64).reshape(-1, len(converters))
    most = np.array([one.most for one in converters])
    return np.where((codes > 0) & (codes < most), _volts(codes, converters), np.nan)


def _volts(codes: FloatArray, converters: Sequence[Converter]) -> FloatArray:
    columns = [_evaluated(one.to_v, codes[:, i]) for i, one in enumerate(converters)]
    return np.stack(columns, axis=1)


def _evaluated(polynomial: Polynomial, values: FloatArray) -> FloatArray:
    # Horner's scheme, as `Polynomial` has it for one value.
    result = np.zeros_like(values)
    for coefficient in reversed(polynomial.coefficients):
        result = result * (values - polynomial.origin) + coefficient
    return result
