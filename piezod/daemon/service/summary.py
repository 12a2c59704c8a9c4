"""The summary of an interval: minimum, maximum and last value, so that no spike is lost."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.daemon.service.stage_service import Document
from piezod.units import NS_PER_S

_MODES: Final = tuple(Mode)
_STATES: Final = tuple(State)
_BLIND: Final = _STATES.index(State.BLIND)


def summarise(
    records: NDArray[Any],
    lost: int,
    axes: Mapping[str, int],
    fault_ids: Callable[[int], Sequence[str]],
) -> Document:
    """Summarise the records of an interval.

    Args:
        records: Of `telemetry.arrays.record_dtype`, shape (n,), n at least 1, oldest first.
        lost: Number of further records, which were lost.
        axes: Names of the axes to report, and their places in a record.
        fault_ids: Returns the ids of the faults in a mask.
    """
    last = records[-1]
    return {
        "t_s": int(last["t_ns"]) / NS_PER_S,
        "cycles": len(records),
        "lost": lost,
        "state": _STATES[last["state"]],
        "shadow": bool(last["shadow"]),
        "faults": list(fault_ids(_mask(records, "present") | _mask(records[-1:], "latched"))),
        "skipped_cycles": int(last["skipped"]),
        "late_max_us": float(records["late_ns"].max()) / 1000,
        "axes": {
            name: _axis(records["axes"][:, place], records["state"] == _BLIND)
            for name, place in axes.items()
        },
    }


def _mask(records: NDArray[Any], name: str) -> int:
    low = np.bitwise_or.reduce(records[f"{name}_lo"])
    high = np.bitwise_or.reduce(records[f"{name}_hi"])
    return int(high) << 64 | int(low)


def _axis(records: NDArray[Any], blind: NDArray[np.bool_]) -> Document:
    last = records[-1]
    # In BLIND the record has only the last written voltage, which need not be in force.
    drive_v = np.where(blind, records["read_back_v"], records["drive_v"])
    position_um, command_um = records["position_um"], records["command_um"]
    return {
        "mode": _MODES[last["mode"]],
        "on_target": bool(last["on_target"]),
        "motion": int(last["motion"]),
        "target_um": float(last["target_um"]),
        "position_um": _range(position_um),
        "command_um": _range(command_um),
        "drive_v": _range(drive_v),
        "error_um": _range(command_um - position_um),
    }


def _range(values: NDArray[Any]) -> Document:
    """Return the range of all values that are numbers; NaN if there is none."""
    return {
        "min": float(np.fmin.reduce(values)),
        "max": float(np.fmax.reduce(values)),
        "last": float(values[-1]),
    }
