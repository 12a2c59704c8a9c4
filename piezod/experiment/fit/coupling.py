"""How far the axes of a stage move each other, from a recording that moves one after the other."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

import piezod
from piezod.config.coupling_file import MOST_SHARE, CouplingFile
from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry

_BLOCK_S: Final = 0.05
"""An axis rests or moves over blocks of this time, in s."""
_MOVING: Final = 1e-3
"""An axis moves if its voltage changes in a block by more than this share of its range."""
_LEAST_SWING_UM: Final = 0.5
_LEAST_SAMPLES: Final = 100
_CLEAR: Final = 5.0
"""A lag is told if it is larger than this many times its uncertainty, and than a period."""


class CoupledPair(NamedTuple):
    """What one axis does to the sensor of another one."""

    moving: str  #: The axis that moves.
    resting: str  #: The axis whose sensor shows it.
    share: float  #: How far 1 µm moves it, in µm.
    uncertainty: float  #: Standard uncertainty of that: the two halves of the motion differ by it.
    swing_um: float  #: Way of the axis that moves, in µm.
    before_um: float  #: Largest error by this coupling in the recording, in µm.
    after_um: float  #: What remains of it, in µm.
    lag_s: float  #: How much later the resting axis moves, in s; 0 if the recording shows none.


@dataclass(frozen=True)
class CouplingFit:
    """The couplings of all axes of a recording."""

    pairs: tuple[CoupledPair, ...]  #: Each pair of axes, both ways.
    source: str  #: Name of the recording.

    def file(self, created_at: str) -> CouplingFile:
        """Return the coupling file; `created_at` is the time, ISO 8601."""
        shares: dict[str, dict[str, float]] = {}
        for pair in self.pairs:
            shares.setdefault(pair.resting, {})[pair.moving] = pair.share
        return CouplingFile(
            created_at=created_at,
            created_by=f"piezod {piezod.__version__}",
            source=self.source,
            shares=shares,
        )


def fit_coupling(path: Path) -> CouplingFit:
    """Fit the couplings of a recording in which one axis after the other moves alone.

    Raises:
        DataError: If an axis never moves alone, moves too little, or moves another one by more than
            half of its way.
        OSError: If the file cannot be read.
    """
    telemetry = read_telemetry(path)
    if "transform" in (telemetry.header.configuration() or {}):
        raise DataError(
            f"{path}: the configuration of this stage has a `transform:` already, so the positions "
            "are free of its coupling: record without it"
        )
    return couplings_in(telemetry, path)


def couplings_in(telemetry: RecordedTelemetry, path: Path) -> CouplingFit:
    """Return the couplings of a recording that was read; the path is for messages."""
    axes = [
        name
        for name, columns in telemetry.axes.items()
        if np.isfinite(columns["position_um"]).any() and np.isfinite(columns["in_force_v"]).any()
    ]
    if len(axes) < 2:
        raise DataError(f"{path}: coupling needs two axes with sensors (got {len(axes)})")
    moves = _moves(telemetry, axes)
    pairs = [
        _pair(telemetry, moving, resting, _alone(path, moves, moving))
        for moving in axes
        for resting in axes
        if resting != moving
    ]
    for pair in pairs:
        if not abs(pair.share) <= MOST_SHARE:
            raise DataError(
                f"{path}: {pair.moving} moves {pair.resting} by {100 * pair.share:.1f} %, allowed: "
                f"at most {100 * MOST_SHARE:g} %; give `sensors:` of the transform, or correct the "
                "wiring"
            )
    return CouplingFit(tuple(pairs), path.name)


def _moves(telemetry: RecordedTelemetry, axes: list[str]) -> dict[str, NDArray[np.bool_]]:
    """Return for each axis and row whether its voltage moves in the block of the row."""
    rows = telemetry.cycles["t_s"].size
    per_block = max(round(_BLOCK_S * telemetry.header.rate_hz), 2)
    starts = np.arange(0, rows, per_block)
    found = {}
    for name in axes:
        drive_v = telemetry.axes[name]["in_force_v"]
        low, high = np.fmin.reduceat(drive_v, starts), np.fmax.reduceat(drive_v, starts)
        swing = np.nanmax(drive_v) - np.nanmin(drive_v)
        moving = ~(high - low <= _MOVING * swing)  # an unknown voltage counts as a motion
        found[name] = np.repeat(moving, per_block)[:rows] if swing > 0.0 else np.zeros(rows, bool)
    return found


def _alone(path: Path, moves: Mapping[str, NDArray[np.bool_]], axis: str) -> slice:
    """Return the longest part in which only this axis moves.

    Raises:
        DataError: If it never does.
    """
    others = np.logical_or.reduce([moving for name, moving in moves.items() if name != axis])
    best = slice(0, 0)
    edges = np.flatnonzero(np.diff(np.concatenate(([True], others, [True])).astype(int)))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        inside = np.flatnonzero(moves[axis][first:end])
        if inside.size and inside[-1] - inside[0] + 1 > best.stop - best.start:
            best = slice(int(first + inside[0]), int(first + inside[-1] + 1))
    if best.stop - best.start < _LEAST_SAMPLES:
        raise DataError(
            f"{path}: axis {axis} moves alone in {best.stop - best.start} samples, allowed: at "
            f"least {_LEAST_SAMPLES}; record a movement of one axis after the other"
        )
    return best


def _pair(telemetry: RecordedTelemetry, moving: str, resting: str, rows: slice) -> CoupledPair:
    t_s = telemetry.cycles["t_s"][rows]
    mover_um, rester_um = (telemetry.axes[name]["position_um"][rows] for name in (moving, resting))
    valid = np.isfinite(mover_um) & np.isfinite(rester_um)
    t_s, mover_um, rester_um = t_s[valid], mover_um[valid], rester_um[valid]
    swing_um = float(np.ptp(mover_um)) if valid.any() else 0.0
    if valid.sum() < _LEAST_SAMPLES or swing_um < _LEAST_SWING_UM:
        raise DataError(
            f"axis {moving} moves alone by {swing_um:.3g} µm in {int(valid.sum())} usable samples, "
            f"allowed: at least {_LEAST_SWING_UM:g} µm and {_LEAST_SAMPLES} samples"
        )
    speed_um_per_s = np.gradient(mover_um, t_s)
    share, late, left_um = _fitted(t_s, mover_um, speed_um_per_s, rester_um)
    half = t_s.size // 2
    halves = [
        _fitted(t_s[part], mover_um[part], speed_um_per_s[part], rester_um[part])
        for part in (slice(None, half), slice(half, None))
    ]
    uncertainty = abs(halves[0][0] - halves[1][0]) / 2
    lag_s = -late / share if share else 0.0
    lag_uncertain_s = abs(halves[0][1] - halves[1][1]) / 2 / abs(share) if share else 0.0
    shown = lag_s > max(_CLEAR * lag_uncertain_s, 1.0 / telemetry.header.rate_hz)
    return CoupledPair(
        moving,
        resting,
        share,
        uncertainty,
        swing_um,
        float(np.max(np.abs(share * (mover_um - mover_um[0])))),
        float(np.max(np.abs(left_um))),
        lag_s if shown else 0.0,
    )


def _fitted(
    t_s: FloatArray, mover_um: FloatArray, speed_um_per_s: FloatArray, rester_um: FloatArray
) -> tuple[float, float, FloatArray]:
    """Return what the resting axis shows of way and speed of the other one, and what it leaves.

    Beside them it creeps: a constant, a straight line and a logarithm of time are fitted, too.
    """
    since_s = t_s - t_s[0]
    terms = (
        mover_um,
        speed_um_per_s,
        np.ones_like(since_s),
        since_s,
        np.log1p(since_s / _BLOCK_S),
    )
    matrix = np.stack(terms, axis=1)
    scale = np.maximum(np.abs(matrix).max(axis=0), 1e-12)
    solution = np.linalg.lstsq(matrix / scale, rester_um, rcond=None)[0] / scale
    return float(solution[0]), float(solution[1]), rester_um - matrix @ solution
