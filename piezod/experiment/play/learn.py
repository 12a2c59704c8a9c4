"""Plays a waveform, looks at the record, corrects the table, and plays it again."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from piezod.devices.played_axis import AxisTable
from piezod.dynamics.learning import Assessment, Average, Learner, average_of
from piezod.errors import PiezodError
from piezod.experiment.play.calibration import SensorLimit, sensor_limit
from piezod.experiment.play.command import PeriodicCommand
from piezod.experiment.play.record import CountedPeriods, check_periods, counted_periods
from piezod.experiment.play.stage import PlayedStage
from piezod.experiment.play.task import LearningTask
from piezod.hysteresis.memory import FloatArray

FEWEST_PERIODS = 4
"""Fewest periods that count: their differences are the noise."""
INVERSE, RESPONSE, STORED = "inverse model", "inverse and response", "stored table"
"""Names of the plays before learning."""


class Errors(NamedTuple):
    """Largest, rms and mean magnitude of an error, in % of the command's swing."""

    max_pct: float
    rms_pct: float
    mean_pct: float

    @classmethod
    def of(cls, error_um: FloatArray, swing_um: float) -> "Errors":
        """Return the errors of samples, in µm."""
        error_pct = 100.0 * np.abs(error_um) / swing_um
        return cls(
            float(np.max(error_pct)),
            float(np.sqrt(np.mean(error_pct**2))),
            float(np.mean(error_pct)),
        )


@dataclass(frozen=True, eq=False)
class PassReport:
    """One play."""

    label: str  #: `INVERSE`, `RESPONSE`, `STORED`, or "pass 1" and so on.
    measured: Errors  #: Errors of the average of the measured periods.
    true: Errors  #: Errors of all true samples that count; NaN if the truth is not known.
    limit: SensorLimit  #: What the calibration of the sensor does to the true error.
    noise_pct: float  #: Rms noise of the average, in % of the swing.
    significant: int  #: Number of learned harmonics whose error exceeds the noise, with the mean.
    table: AxisTable  #: Table of the play.
    error_um: (
        FloatArray  #: (n,) command minus measured displacement, average of the periods, in µm.
    )
    #: (n,) command minus true displacement, average of the periods, in µm.
    true_error_um: FloatArray

    @property
    def knows_truth(self) -> bool:
        """Whether the true displacement is known."""
        return bool(np.isfinite(self.true_error_um).all())


@dataclass(frozen=True, eq=False)
class LearnedPlay:
    """Result of learning."""

    given: PeriodicCommand  #: The command as given.
    command: PeriodicCommand  #: The command with learned harmonics only; errors refer to it.
    reports: tuple[PassReport, ...]  #: All plays, in order.
    best: PassReport  #: The play with the smallest measured error among those with the response.
    wanted_um: FloatArray  #: (n,) input of the inverse model of that play, in µm.
    stopped: str  #: Why learning stopped, for people.


def learn(
    stage: PlayedStage,
    task: LearningTask,
    report: Callable[[PassReport], None],
    *,
    compare: bool = False,
) -> LearnedPlay:
    """Learn the table of a command, pass by pass; the last play may not be the best one.

    A failure after the first pass ends learning, with the best table so far.

    Args:
        stage: The axis.
        task: What is learned.
        report: Called after each play.
        compare: Whether the inverse model alone is played first, for comparison.

    Raises:
        PiezodError: If the first pass failed: nothing is learned then.
    """
    run = _Run(stage, task, report)
    if compare:
        run.play(INVERSE, lambda _t_s: task.command.values_um)
    learner, first = run.learner, len(run.reports)
    label = RESPONSE if task.first_um is None else STORED
    stop = learner.take(run.play(label, learner.next))
    stopped, number = "", 0
    while stop is None:
        number += 1
        try:
            stop = learner.take(run.play(f"pass {number}", learner.next))
        except PiezodError as error:
            stopped = str(error)
            break
    best = run.reports[first + learner.best_pass]
    reason = stopped if stop is None else stop.value
    return LearnedPlay(task.given, task.command, tuple(run.reports), best, learner.best, reason)


class _Run:
    """The plays of one task."""

    def __init__(
        self, stage: PlayedStage, task: LearningTask, report: Callable[[PassReport], None]
    ) -> None:
        self._stage, self._task, self._report = stage, task, report
        command, settings = task.command, task.settings
        self.learner = Learner(
            command.values_um,
            task.harmonics,
            settings.passes,
            task.static_gain,
            task.first_um,
            task.drift,
        )
        self.reports: list[PassReport] = []
        self._counted = command.cycles(settings.record_s, FEWEST_PERIODS)
        self._cycles = command.cycles(settings.settle_s, 1) + self._counted

    def play(self, label: str, wanted_at: Callable[[float], FloatArray]) -> Assessment:
        """Play an input from rest; report the play, and return its error.

        Args:
            label: Name of the play.
            wanted_at: Returns the input for the time at which the play begins, in s.
        """
        at_rest = self._stage.rest()
        wanted_um = wanted_at(at_rest.t_s)
        table = self._task.maker.table(wanted_um, at_rest.drive_v, self._cycles)
        periods = counted_periods(self._stage.play(table), table, self._counted)
        check_periods(periods.position_um, self.learner.expected(wanted_um))
        average = average_of(periods.position_um)
        found = self.learner.assess(average)
        self.reports.append(self._reported(label, table, periods, average, found))
        self._report(self.reports[-1])
        return found

    def _reported(
        self,
        label: str,
        table: AxisTable,
        periods: CountedPeriods,
        average: Average,
        found: Assessment,
    ) -> PassReport:
        command = self._task.command
        true_error_um = command.values_um - periods.true_um
        # All lines of the average but its mean, which is not part of a noise over a period.
        noise_um = np.sqrt(2.0 * np.sum(average.noise[1:] ** 2)) / command.values_um.size
        return PassReport(
            label,
            Errors.of(found.error, command.swing_um),
            Errors.of(true_error_um, command.swing_um),
            sensor_limit(periods, command.values_um, self._task.harmonics.sensor),
            100.0 * float(noise_um) / command.swing_um,
            found.significant,
            table,
            found.error,
            np.mean(true_error_um, axis=0),
        )
