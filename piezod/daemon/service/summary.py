"""The summary of an interval: minimum, maximum and last value, so that no spike is lost."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, get_type_hints

import numpy as np
from numpy.typing import NDArray

from piezod.config.states import State
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry
from piezod.telemetry.layout import as_shown
from piezod.units import NS_PER_S

_BLIND: Final = tuple(State).index(State.BLIND)
_FIELDS: Final = get_type_hints(AxisTelemetry)


def summarise(
    records: NDArray[Any],
    lost: int,
    axes: Mapping[str, int],
    fault_ids: Callable[[int], Sequence[str]],
) -> Telemetry:
    """Summarise the records of an interval.

    Args:
        records: Of `telemetry.arrays.record_dtype`, shape (n,), n at least 1, oldest first.
        lost: Number of further records, which were lost.
        axes: Names of the axes to report, and their places in a record.
        fault_ids: Returns the ids of the faults in a mask.
    """
    last = records[-1]
    return Telemetry(
        t_s=int(last["t_ns"]) / NS_PER_S,
        cycles=len(records),
        lost=lost,
        state=as_shown("state", last["state"]),
        shadow=bool(last["shadow"]),
        faults=tuple(fault_ids(_mask(records, "present") | _mask(records[-1:], "latched"))),
        skipped_cycles=int(last["skipped"]),
        late_max_us=float(records["late_ns"].max()) / 1000,
        axes={
            name: _axis(records["axes"][:, place], records["state"] == _BLIND)
            for name, place in axes.items()
        },
    )


def _mask(records: NDArray[Any], name: str) -> int:
    low = np.bitwise_or.reduce(records[f"{name}_lo"])
    high = np.bitwise_or.reduce(records[f"{name}_hi"])
    return int(high) << 64 | int(low)


def _axis(records: NDArray[Any], blind: NDArray[np.bool_]) -> AxisTelemetry:
    # In BLIND the record has only the last written voltage, which need not be in force.
    values = {
        "drive_v": np.where(blind, records["read_back_v"], records["drive_v"]),
        "error_um": records["command_um"] - records["position_um"],
    }
    last = records[-1]
    shown: dict[str, Any] = {
        name: _range(values[name] if name in values else records[name])
        if kind is Range
        else as_shown(name, last[name].item())
        for name, kind in _FIELDS.items()
    }
    return AxisTelemetry(**shown)


def _range(values: NDArray[Any]) -> Range:
    """Return the range of all values that are numbers; None if there is none."""
    found = np.fmin.reduce(values), np.fmax.reduce(values), values[-1]
    low, high, last = (as_shown("", float(each)) for each in found)
    return Range(min=low, max=high, last=last)
