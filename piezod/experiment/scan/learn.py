"""Learns a scan: the line that repeats, then offset and size of each sweep, frame by frame.

First the line alone is learned as any periodic waveform (`experiment/play`), while the other axes
rest. Then whole frames are played. A stage creeps during a frame, and its loops are not those of
the line alone, so each sweep gets an offset and a size of its own, forward and backward. What all
sweeps have in common corrects the line.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from piezod.dynamics.harmonics import GAIN, Harmonics
from piezod.dynamics.model import ComplexArray, ResponseModel
from piezod.errors import DataError
from piezod.experiment.play.task import KnownAxis
from piezod.experiment.scan.pixels import (
    ErrorCount,
    PixelErrors,
    SweepSamples,
    pixels_of,
)
from piezod.experiment.scan.plan import ScanPlan
from piezod.experiment.scan.positions import Marks
from piezod.experiment.scan.stage import ScanStage, ScanTable
from piezod.experiment.scan.tables import (
    AxisVoltages,
    Corrections,
    known_delays_s,
    scan_table,
    stepped_voltages,
    swept_voltages,
)
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S

MOST_GAIN = 3.0
"""Largest factor by which the voltage per displacement of a frame may differ from the model's."""
MOST_DRIFT = 0.5
"""Largest drift from frame to frame that is foreseen, in pixels."""
FORESEEN = 0.5
"""Share of a drift that the next frame contains."""
NEIGHBOURS = 6
"""Sweeps of the same way on each side over which corrections are smoothed."""
LIKE = 0.8
"""Least correlation of a correction and what it has moved, to learn from it how far a volt goes."""
GREW = 1.5
"""Learning ends if the error grows by this factor in a frame; the table before it is used."""


class FrameReport(NamedTuple):
    """One frame."""

    label: str  #: "frame 1" and so on.
    measured: PixelErrors  #: Errors of the measured positions, in pixels.
    true: PixelErrors  #: Errors of the true positions; NaN if they are not known.

    @property
    def knows_truth(self) -> bool:
        """Whether the true positions are known."""
        return self.true.has_fast or self.true.has_slow


@dataclass(frozen=True, eq=False)
class ScanTask:
    """What is scanned, and what is known of the axes."""

    plan: ScanPlan
    known: Mapping[str, KnownAxis]  #: What is known of each axis, by name.
    rest_v: Mapping[str, float]  #: Voltage at rest of each axis, in V.
    lines_um: FloatArray  #: (p · m, swept) input of the inverse model for each line, in µm.
    line_learned: bool  #: Whether they were learned alone.
    passes: int  #: Largest number of corrections of the frame.

    @property
    def sensor_delay_s(self) -> FloatArray:
        """Delay of each sensor, in s, shape (axes,)."""
        return known_delays_s(self.known, self.plan)


class LearnedFrame(NamedTuple):
    """A frame to play."""

    table: ScanTable  #: Its table.
    marks: Marks | None  #: Its pulses at positions; None for none.


def learn_frame(
    stage: ScanStage, task: ScanTask, report: Callable[[FrameReport], None]
) -> LearnedFrame:
    """Return the frame with the smallest error.

    Args:
        stage: The stage.
        task: What is scanned.
        report: Called after each frame.

    Raises:
        PiezodError: If a frame could not be played, or its record cannot be used.
    """
    frame = _Frame(task)
    best = next_one = frame.next_one()
    smallest = np.inf
    for number in range(1, task.passes + 1):
        stage.rest()
        found = frame.learn(stage.scan(next_one.table), f"frame {number}")
        report(found.report)
        if found.rms > GREW * smallest:
            return best
        best, next_one, smallest = next_one, frame.next_one(), min(smallest, found.rms)
    return next_one


class LineSum:
    """Adds up the cycles of the line in a frame, sample by sample."""

    def __init__(self, plan: ScanPlan) -> None:
        self._points = plan.points
        size = len(plan.lines_um)
        self._cycle, self._cycles = np.zeros(size), 0
        self._sum = np.zeros(size // 2 + 1, np.complex128)
        self._differences, self._before = np.zeros(size // 2 + 1), self._sum

    def add(self, sweep: int, position_um: FloatArray) -> None:
        """Add a sweep; sweeps come in their order."""
        first = sweep * self._points % self._cycle.size
        self._cycle[first : first + self._points] = position_um
        if first + self._points < self._cycle.size:
            return
        spectrum = np.fft.rfft(self._cycle)
        self._sum += spectrum
        if self._cycles:
            self._differences += np.abs(spectrum - self._before) ** 2
        self._before, self._cycles = spectrum, self._cycles + 1

    def spectrum(self) -> tuple[ComplexArray, FloatArray]:
        """Return the harmonics of the mean cycle, and their standard deviations.

        With fewer than two cycles the deviations are infinite: nothing is known of them.
        """
        n = max(self._cycles, 1)
        if self._cycles < 2:
            return self._sum / n, np.full(self._sum.size, np.inf)
        return self._sum / n, np.sqrt(self._differences / (2.0 * (n - 1) * n))


class _Step(NamedTuple):
    offset_um: FloatArray  # error of each sweep and axis before the correction
    step_um: FloatArray  # the correction
    v_per_um: FloatArray  # voltage per displacement by which it was made


class _Found(NamedTuple):
    report: FrameReport
    rms: float  # of what a frame can correct, in pixels


class _Frame:
    """The voltages of a frame, and their corrections."""

    def __init__(self, task: ScanTask) -> None:
        self._task, self._plan = task, task.plan
        self._lines_um = task.lines_um.copy()
        # Where the swept axes are expected in a period of the line.
        self._motion_um = task.plan.lines_um.copy()
        self._corrections = Corrections.none(task.plan)
        plan = task.plan
        self._stepped = {
            name: stepped_voltages(task.known[name], plan, plan.levels_um[:, i], task.rest_v[name])
            for i, name in enumerate(plan.axes)
            if i >= plan.swept
        }
        self._before: _Step | None = None
        # The first half of the frames corrects whole a line that was not learned alone.
        self._averaged = 0 if task.line_learned else -(task.passes // 2)
        self._harmonics = [_harmonics(task, i) for i in range(plan.swept)]

    def next_one(self) -> LearnedFrame:
        """Return the next frame."""
        task, plan = self._task, self._plan
        voltages: list[AxisVoltages] = []
        for i, name in enumerate(plan.axes):
            if name in self._stepped:
                voltages.append(self._stepped[name])
            else:
                known, rest_v = task.known[name], task.rest_v[name]
                voltages.append(swept_voltages(known, plan, self._lines_um[:, i], rest_v))
        marks, pulses = None, plan.pulses
        marked = plan.marked
        if marked is not None and not marked.by_device:
            marks = Marks.of(plan, marked, self._motion_um[:, 0])
            pulses = marks.mask(plan)
        return LearnedFrame(scan_table(plan, voltages, self._corrections, pulses), marks)

    def learn(self, sweeps: Iterator[SweepSamples], label: str) -> _Found:
        """Correct the voltages by the record of a frame."""
        plan, delays_s = self._plan, self._task.sensor_delay_s
        measured, true = ErrorCount(plan), ErrorCount(plan)
        offset_um = np.zeros((plan.sweeps, len(plan.axes)))
        size = np.zeros((plan.sweeps, plan.swept))
        lines = [LineSum(plan) for _ in range(plan.swept)]
        for samples in sweeps:
            _require_whole(samples)
            k = samples.sweep
            pixels = pixels_of(samples, plan, delays_s)
            measured.add(k, pixels.position_um)
            true.add(k, pixels.true_um)
            wanted_um = plan.pixel_means(plan.command_um(k))
            error_um = wanted_um - pixels.position_um
            offset_um[k] = np.mean(error_um, axis=0)
            for i, line in enumerate(lines):
                size[k, i] = _slope(wanted_um[:, i], error_um[:, i])
                line.add(k, samples.position_um[:, i])
        ways = plan.sweeps_per_period
        rms = self._correct(smoothed(offset_um, ways), smoothed(size, ways), lines)
        return _Found(FrameReport(label, measured.errors, true.errors), rms)

    def _correct(self, offset_um: FloatArray, size: FloatArray, lines: Sequence[LineSum]) -> float:
        plan = self._plan
        offset_v, scale = (part.copy() for part in self._corrections)
        v_per_um = self._v_per_um(offset_um)
        step_um = offset_um + self._drift_um(offset_um)
        self._before = _Step(offset_um, step_um, v_per_um)
        offset_v += step_um * v_per_um
        scale[:, : plan.swept] *= 1.0 + size
        self._corrections = Corrections(offset_v, scale)
        parts = [np.mean((offset_um / plan.pixel_um) ** 2)]
        # Smaller steps from frame to frame average the noise.
        self._averaged += 1
        for i, line in enumerate(lines):
            shape_um = self._shape(line, i)
            self._lines_um[:, i] += shape_um
            pixel_um, line_um = plan.pixel_um[i], plan.lines_um[:, i]
            parts.append(np.mean((shape_um / pixel_um) ** 2))
            swing = 0.25 * np.ptp(line_um) / pixel_um  # about the rms value of a line, in pixels
            parts.append(np.mean((size[:, i] * swing) ** 2))
        return float(np.sqrt(sum(parts)))

    def _v_per_um(self, offset_um: FloatArray) -> FloatArray:
        """Return the voltage per displacement of each axis, shape (axes,), in V/µm.

        The last correction has shown it: a stage creeps, and small steps move it less than its
        loops would.
        """
        if self._before is None:
            return np.array([self._task.known[name].maker.v_per_um for name in self._plan.axes])
        moved, meant = (
            values - np.mean(values, axis=0)
            for values in (self._before.offset_um - offset_um, self._before.step_um)
        )
        power, product = np.sum(moved**2, axis=0), np.sum(meant * moved, axis=0)
        like = product >= LIKE * np.sqrt(power * np.sum(meant**2, axis=0))
        shown = np.where(like & (power > 0.0), product / np.where(power > 0.0, power, 1.0), 1.0)
        return np.asarray(self._before.v_per_um * np.clip(shown, 1.0 / MOST_GAIN, MOST_GAIN))

    def _drift_um(self, offset_um: FloatArray) -> FloatArray:
        """Return how far each axis has drifted since the frame before, shape (axes,), in µm.

        The next frame is as late again, so its table contains a part of the same once more: creep
        becomes slower.
        """
        if self._before is None:
            return np.zeros(len(self._plan.axes))
        drift_um = np.mean(offset_um - self._before.offset_um + self._before.step_um, axis=0)
        pixel_um = self._plan.pixel_um
        return np.asarray(
            FORESEEN * np.clip(drift_um, -MOST_DRIFT * pixel_um, MOST_DRIFT * pixel_um)
        )

    def _shape(self, line: LineSum, place: int) -> FloatArray:
        """Return the correction of a line: without its mean and size, which each sweep has."""
        line_um, harmonics = self._plan.lines_um[:, place], self._harmonics[place]
        target = np.fft.rfft(line_um) * harmonics.sensor
        mean, noise = line.spectrum()
        error = target - mean
        size = np.vdot(target[1:], error[1:]).real / np.vdot(target[1:], target[1:]).real
        error = error - size * target
        error[0] = 0.0
        # What is noise in an error is not corrected: on the average its square is noise².
        power = np.abs(error) ** 2
        sure = 1.0 - np.minimum(noise**2, power) / np.where(power > 0.0, power, 1.0)
        gain = GAIN * sure / max(self._averaged, 1)
        correction = np.where(harmonics.learned, gain * error / harmonics.response, 0.0)
        left = (sure * error - harmonics.response * correction) / harmonics.sensor
        self._motion_um[:, place] = line_um - np.fft.irfft(left, line_um.size)
        return np.fft.irfft(correction, line_um.size)


def _harmonics(task: ScanTask, place: int) -> Harmonics:
    plan, known = task.plan, task.known[task.plan.axes[place]]
    frequency_hz = np.asarray(
        np.fft.rfftfreq(len(plan.lines_um), plan.interval_ns / NS_PER_S), np.float64
    )
    return Harmonics.known(
        frequency_hz,
        known.response.at,
        ResponseModel(known.sensor_delay_s).at,
        known.response.uncertainty(frequency_hz),
        known.response.shift,
    )


def smoothed(values: FloatArray, ways: int) -> FloatArray:
    """Return values of each sweep, smoothed over neighbours of the same way, shape (sweeps, n).

    The noise of a sweep is no error of the stage, whose creep changes slowly from line to line. At
    the ends there are fewer neighbours: the first sweep has none, because creep is fastest there.

    Args:
        values: (sweeps, n) values.
        ways: 2 if every other sweep goes back.
    """
    smooth = values.copy()
    for way in range(ways):
        own = values[way::ways]
        sums = np.vstack((np.zeros(values.shape[1]), np.cumsum(own, axis=0)))
        k = np.arange(len(own))
        half = np.minimum(np.minimum(k, k[::-1]), NEIGHBOURS)
        smooth[way::ways] = (sums[k + half + 1] - sums[k - half]) / (2 * half + 1)[:, None]
    return smooth


def _slope(command_um: FloatArray, error_um: FloatArray) -> float:
    """Return the part of an error that grows with the command, as a share of it."""
    about = command_um - np.mean(command_um)
    power = float(about @ about)
    return float(about @ error_um) / power if power else 0.0


def _require_whole(samples: SweepSamples) -> None:
    lost = int(np.count_nonzero(~np.isfinite(samples.position_um)))
    if lost:
        raise DataError(
            f"{lost} of {samples.position_um.size} samples of sweep {samples.sweep} are missing or "
            "invalid; check the range of the sensor and the connection"
        )
