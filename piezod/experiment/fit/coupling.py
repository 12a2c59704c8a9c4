"""How far the axes of a stage move each other, from a recording that moves one after the other."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

import piezod
from piezod.config.coupling_file import MOST_LAG_S, MOST_SHARE, CouplingFile
from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry
from piezod.units import NS_PER_S

_BLOCK_S: Final = 0.05
"""An axis rests or moves over blocks of this time, in s."""
_MOVING: Final = 1e-3
"""An axis moves if its voltage changes in a block by more than this share of its range."""
_LEAST_SWING_UM: Final = 0.5
_LEAST_SAMPLES: Final = 100
_CLEAR: Final = 3.0
"""A lag is there if that of one half makes the errors of the other half smaller, beyond noise by
this factor, and the other way round."""


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
    lag_uncertainty_s: float  #: Standard uncertainty of that, in s, also of a lag of 0.


@dataclass(frozen=True)
class CouplingFit:
    """The couplings of all axes of a recording."""

    pairs: tuple[CoupledPair, ...]  #: Each pair of axes, both ways.
    source: str  #: Name of the recording.

    def file(self, created_at: str) -> CouplingFile:
        """Return the coupling file; `created_at` is the time, ISO 8601."""
        shares: dict[str, dict[str, float]] = {}
        lags_s: dict[str, dict[str, float]] = {}
        for pair in self.pairs:
            shares.setdefault(pair.resting, {})[pair.moving] = pair.share
            if pair.lag_s:
                lags_s.setdefault(pair.resting, {})[pair.moving] = pair.lag_s
        return CouplingFile(
            created_at=created_at,
            created_by=f"piezod {piezod.__version__}",
            source=self.source,
            shares=shares,
            lags_s=lags_s,
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


class _Motion(NamedTuple):
    """Rows of a motion, (n,) each; means over a block, so that noise does not hide the speed."""

    since_s: FloatArray
    mover_um: FloatArray
    speed_um_per_s: FloatArray
    rester_um: FloatArray

    def part(self, rows: slice) -> "_Motion":
        return _Motion(*(column[rows] for column in self))

    def fitted(self, late: float | None = None) -> tuple[float, float, FloatArray]:
        """Return what the resting axis shows of way and speed of the other one, and what it leaves.

        Beside them it creeps: a constant, a straight line and a logarithm of time are fitted, too.

        Args:
            late: What it shows of the speed, if that is known, in s.
        """
        since_s = self.since_s
        creep = (np.ones_like(since_s), since_s, np.log1p(since_s / _BLOCK_S))
        speed = () if late is not None else (self.speed_um_per_s,)
        matrix = np.stack((self.mover_um, *creep, *speed), axis=1)
        shown_um = self.rester_um - (late or 0.0) * self.speed_um_per_s
        scale = np.maximum(np.abs(matrix).max(axis=0), 1e-12)
        solution = np.linalg.lstsq(matrix / scale, shown_um, rcond=None)[0] / scale
        found = float(solution[-1]) if late is None else late
        return float(solution[0]), found, shown_um - matrix @ solution


def _pair(telemetry: RecordedTelemetry, moving: str, resting: str, rows: slice) -> CoupledPair:
    motion = _motion(telemetry, moving, resting, rows)
    share, late, left_um = motion.fitted()
    half = motion.since_s.size // 2
    halves = motion.part(slice(None, half)), motion.part(slice(half, None))
    fits = [each.fitted() for each in halves]
    lag_s, uncertain_s = 0.0, 0.0
    if share:
        lag_s = -late / share
        uncertain_s = abs(fits[0][1] - fits[1][1]) / 2 / abs(share)
    shown = 0.0 < lag_s <= MOST_LAG_S and _held_out(halves, (fits[1][1], fits[0][1]))
    return CoupledPair(
        moving,
        resting,
        share,
        abs(fits[0][0] - fits[1][0]) / 2,
        float(np.ptp(motion.mover_um)),
        float(np.max(np.abs(share * (motion.mover_um - motion.mover_um[0])))),
        float(np.max(np.abs(left_um))),
        lag_s if shown else 0.0,
        uncertain_s,
    )


def _motion(telemetry: RecordedTelemetry, moving: str, resting: str, rows: slice) -> _Motion:
    """Return the motion in these rows.

    Raises:
        DataError: If it is too small or too short.
    """
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
    size = min(max(round(_BLOCK_S * telemetry.header.rate_hz), 2), t_s.size // 10)
    block = np.full(size, 1.0 / size)
    t_s, mover_um, rester_um = (
        np.convolve(each, block, mode="valid") for each in (t_s, mover_um, rester_um)
    )
    later_s = _seen_later_s(telemetry, moving, resting, rows)
    rester_um = np.interp(t_s + later_s, t_s, rester_um)
    motion = _Motion(t_s - t_s[0], mover_um, np.gradient(mover_um, t_s), rester_um)
    return motion.part(slice(None, None, max(size // 2, 1)))


def _held_out(halves: tuple[_Motion, _Motion], lates: tuple[float, float]) -> bool:
    """Return whether each half is described better with what the other one shows of the speed."""
    for half, late in zip(halves, lates, strict=True):
        without, with_lag = (float(np.square(half.fitted(each)[2]).sum()) for each in (0.0, late))
        if without - with_lag <= _CLEAR**2 * with_lag / half.since_s.size:
            return False
    return True


def _seen_later_s(telemetry: RecordedTelemetry, moving: str, resting: str, rows: slice) -> float:
    """Return how much later the sensor of the resting axis shows the same instant, in s."""
    axes = (telemetry.header.configuration() or {}).get("axes", {})

    def later_s(name: str) -> float:
        delay_s = float(axes.get(name, {}).get("compensator", {}).get("sensor_delay_s", 0.0))
        if "sample_ns" not in telemetry.axes[name]:
            return delay_s
        after_ns = telemetry.axes[name]["sample_ns"] - telemetry.cycles["t_ns"]
        return delay_s - float(np.nanmedian(after_ns[rows])) / NS_PER_S

    return later_s(resting) - later_s(moving)
