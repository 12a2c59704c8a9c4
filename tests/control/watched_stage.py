"""A stage that moves in proportion, with noise, for tests of the sensor watch."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from piezod.control.faults.detection import Detection
from piezod.control.watch.sensor import SensorWatch, WatchedSensor
from piezod.devices.interface import Sample
from piezod.devices.status import NO_FLAGS, Flags
from piezod.hysteresis.normalisation import AffineRange
from tests.control.fakes import MS

DRIVE_V = AffineRange(0.0, 150.0)
POSITION_UM = AffineRange(0.0, 30.0)
SIGMA_UM = 0.018


class WatchInput(NamedTuple):
    """Arguments of the watch in a cycle."""

    t_ns: int
    sample: Sample
    in_force_v: float
    flags: Flags = NO_FLAGS
    driven: bool = True
    needed: bool = True

    def showing(self, position_um: float) -> "WatchInput":
        """Return the same with another position."""
        return self._replace(sample=self.sample._replace(position_um=position_um))


Disturb = Callable[[int, WatchInput], WatchInput]


def sine_v(k: int) -> float:
    """Return a drive between 5 and 145 V at 1 Hz, in cycles of 1 ms."""
    return 75.0 - 70.0 * math.cos(2e-3 * math.pi * k)


def at_rest_v(k: int) -> float:  # noqa: ARG001 - a drive is a function of the cycle
    """Return a constant drive."""
    return 75.0


def undisturbed(k: int, inputs: WatchInput) -> WatchInput:  # noqa: ARG001 - the one that disturbs nothing
    """Return the input unchanged."""
    return inputs


def measured(cycles: int, drive_v: Callable[[int], float] = sine_v) -> Iterator[WatchInput]:
    """Yield the cycles of a stage that follows its drive, 0.2 µm/V, with noise."""
    noise_um = np.random.default_rng(1).normal(0.0, SIGMA_UM, cycles).tolist()
    for k in range(cycles):
        volts, t_ns = drive_v(k), (k + 1) * MS
        yield WatchInput(t_ns, Sample(t_ns, 0.2 * volts + noise_um[k], True), volts)


class WatchResult(NamedTuple):
    """Result of a watch over a run."""

    faults: list[list[Detection]]
    samples: list[Sample]

    def ids(self, cycle: int) -> list[str]:
        """Return the faults in a cycle."""
        return [detection.fault for detection in self.faults[cycle]]

    def first(self, fault: str) -> int:
        """Return the first cycle with a fault, -1 if there is none."""
        return next((k for k in range(len(self.faults)) if fault in self.ids(k)), -1)

    @property
    def all_ids(self) -> set[str]:
        """All faults of the run."""
        return {fault for k in range(len(self.faults)) for fault in self.ids(k)}


def watch(sensor: WatchedSensor | None = None) -> SensorWatch:
    """Return the watch of the first axis, at 1 kHz, without a model."""
    return SensorWatch(0, sensor or WatchedSensor(DRIVE_V, POSITION_UM), MS)


def run_watch(
    inputs: Iterator[WatchInput], disturb: Disturb = undisturbed, subject: SensorWatch | None = None
) -> WatchResult:
    """Run a watch over all cycles."""
    subject = subject or watch()
    faults, samples = [], []
    for k, cycle in enumerate(inputs):
        disturbed = disturb(k, cycle)
        found = subject.check(
            cycle.t_ns,
            disturbed.sample,
            disturbed.flags,
            disturbed.in_force_v,
            math.nan,
            driven=disturbed.driven,
            needed=disturbed.needed,
        )
        faults.append(list(found))
        samples.append(subject.sample)
    return WatchResult(faults, samples)
