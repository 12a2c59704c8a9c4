"""Pulses at positions: when the fast axis passes each, by the motion that was learned."""

from typing import NamedTuple

import numpy as np

from piezod.devices.player import Comparison
from piezod.devices.scan_table import Mask
from piezod.experiment.scan.pixels import Int64Array, SweepSamples, later
from piezod.experiment.scan.plan import MarkedPositions, ScanPlan
from piezod.hysteresis.memory import FloatArray
from piezod.records.scan_file import SweptPulses
from piezod.units import NS_PER_S


def way_of(marked: MarkedPositions) -> str:
    """Return how the pulses come to their positions."""
    return "compared by the device" if marked.by_device else "by time from the learned motion"


def compared(plan: ScanPlan, marked: MarkedPositions, delay_s: float) -> Comparison | None:
    """Return the readings, from the zero of the sensor, at which a device pulses; None by time.

    The sensor shows a position late: at the speed of the sweep it then shows one before.

    Args:
        plan: The plan.
        marked: Its positions, in even steps.
        delay_s: Delay of the sensor of the fast axis, in s.
    """
    if not marked.by_device:
        return None
    along_um = marked.along_um[:: -1 if True in marked.backward else 1]
    up = 1.0 if along_um[-1] > along_um[0] else -1.0
    step_um = float(np.mean(np.diff(along_um)))
    speed = up * float(plan.pixel_um[0]) * NS_PER_S / (plan.per_pixel * plan.interval_ns)
    first_um, last_um = (float(along_um[i]) - speed * delay_s for i in (0, -1))
    return Comparison(marked.bit.bit_length(), 0, first_um, last_um + 0.5 * step_um, step_um)


class Marks(NamedTuple):
    """Where pulses at positions begin in the sweeps of a period of the line, in order of time."""

    bit: int  #: Their line, as a bit.
    point: Int64Array  #: (k,) point of the period.
    wanted_um: FloatArray  #: (k,) position that it marks, in µm.

    @classmethod
    def of(cls, plan: ScanPlan, marked: MarkedPositions, motion_um: FloatArray) -> "Marks":
        """Return the marks of a motion of the fast axis.

        Args:
            plan: The plan.
            marked: Its positions.
            motion_um: (p · points,) true position in a period of the line, in µm.
        """
        points, wanted_um = [np.empty(0, np.int64)], [np.empty(0)]
        for k in range(plan.sweeps_per_period):
            if plan.backward(k) in marked.backward:
                along_um = marked.along_um[:: -1 if plan.backward(k) else 1]
                points.append(_passes(plan, motion_um, k, along_um))
                wanted_um.append(along_um)
        return cls(marked.bit, np.concatenate(points), np.concatenate(wanted_um))

    def mask(self, plan: ScanPlan) -> Mask:
        """Return all pulses of a period of the line, with those of the plan."""
        mask = np.tile(plan.pulses, plan.sweeps_per_period)
        apart = np.diff(self.point, append=self.point[:1] + mask.size)
        for i in range(max(1, min(plan.high, int(apart.min()) // 2))):
            mask[(self.point + i) % mask.size] |= np.uint8(self.bit)
        return mask


def _passes(plan: ScanPlan, motion_um: FloatArray, k: int, along_um: FloatArray) -> Int64Array:
    """Return the points nearest to those at which a sweep of the period passes positions."""
    m, turn = plan.points, plan.points - plan.active
    up = 1.0 if motion_um[k * m + plan.active - 1] > motion_um[k * m] else -1.0
    # From the turn before the sweep to that behind it, between which the axis goes one way.
    at = np.arange(k * m - turn, (k + 1) * m)
    way_um = up * motion_um[at % motion_um.size]
    one_way = slice(int(np.argmin(way_um[: turn + 1])), m + int(np.argmax(way_um[m:])) + 1)
    at, way_um = at[one_way], way_um[one_way]
    # With noise it passes some positions more than once: the mean of the first and the last time.
    ahead, behind = np.maximum.accumulate(way_um), np.minimum.accumulate(way_um[::-1])[::-1]
    passed = np.interp(up * along_um, 0.5 * (ahead + behind), at)
    return np.clip(np.rint(passed).astype(np.int64), k * m, (k + 1) * m - 1)


class PulseErrors:
    """Adds up how far from their positions the pulses of a frame were, measured and true.

    Args:
        plan: The plan.
        marked: Its positions.
        marks: Its pulses; None if the device compares: they are where the record passes, then.
        delay_s: Delay of the sensor of the fast axis, in s.
    """

    def __init__(
        self, plan: ScanPlan, marked: MarkedPositions, marks: Marks | None, delay_s: float
    ) -> None:
        self._plan, self._marked, self._marks, self.delay_s = plan, marked, marks, delay_s
        self._swing_um = float(plan.pixel_um[0]) * plan.pixels
        self._count, self._max, self._squares = 0, np.zeros(2), np.zeros(2)

    def add(self, samples: SweepSamples) -> SweptPulses:
        """Add a sweep; return its pulses."""
        plan, first = self._plan, samples.sweep % self._plan.sweeps_per_period * self._plan.points
        delay = self.delay_s * NS_PER_S / plan.interval_ns
        position_um, marks = later(samples.position_um[:, 0], delay), self._marks
        if marks is None:
            motion_um = plan.lines_um[:, 0].copy()
            motion_um[first : first + plan.points] = position_um
            marks = Marks.of(plan, self._marked, motion_um)
        own = (marks.point >= first) & (marks.point < first + plan.points)
        at, wanted_um = marks.point[own] - first, marks.wanted_um[own]
        pulses = SweptPulses(
            samples.first_ns + at * plan.interval_ns,
            wanted_um,
            position_um[at] - wanted_um,
            samples.true_um[at, 0] - wanted_um,
        )
        errors = np.stack((pulses.error_um, pulses.true_error_um))
        self._count += errors.shape[1]
        self._max = np.maximum(self._max, np.max(np.abs(errors), axis=1, initial=0.0))
        self._squares += np.sum(errors**2, axis=1)
        return pulses

    @property
    def document(self) -> dict[str, float | str]:
        """Number, way and errors; the true ones only where they are known."""
        rms_um = np.sqrt(self._squares / max(self._count, 1))
        document: dict[str, float | str] = {"count": self._count, "way": way_of(self._marked)}
        for name, worst, rms in zip(("measured", "true"), self._max, rms_um, strict=True):
            if np.isfinite(worst):
                document |= {
                    f"{name}_max_um": float(worst),
                    f"{name}_rms_um": float(rms),
                    f"{name}_max_pct": float(100.0 * worst / self._swing_um),
                }
        return document

    @property
    def text(self) -> str:
        """The same as a sentence."""
        of = self.document
        off = (
            f"{name} {of[f'{name}_max_um']:.4f} um, {of[f'{name}_max_pct']:.3f} % of the swing"
            for name in ("measured", "true")
            if f"{name}_max_um" in of
        )
        return f"{self._count} pulses at positions, {of['way']}; off by at most: {'; '.join(off)}"
