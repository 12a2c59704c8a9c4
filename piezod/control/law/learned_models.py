"""Which learned models are used: near the identified one, and proven.

The distance of two models is a difference of drives: of those that they request along the widest
loop, up and down. It covers slopes, gain and drift of every form with one number. The weights alone
mean little, because neighbouring operators can exchange slope without an effect on their sum.

A sensor whose gain or zero lies looks like a stage that has changed. The bound limits what such a
lie can teach: at the bound, learning goes on within it.

A learned model is used only while it predicts no worse than the identified one, and while it
differs from that by more than an unknown lag and noise explain.

Both predict the displacement of the same samples from the voltage, which has no noise, each before
the learned one has learned from the sample. Noise is in both errors, so that the difference of
their squares shows little of it: over some windows, a mean beyond two of its standard errors is no
chance. (Voltages that are predicted from noisy displacements would not do: a model that has learned
from noise is better at that.) A learned model that is not used goes on learning, and is used again
when it predicts better.

Samples show a moving stage later than it is, or earlier, and larger or smaller: the first mode
rings between two of them, and filters delay them. In fast motion that looks like hysteresis: the
samples suit the model that has learned it, and the stage errs more. The change of the drive in a
cycle, and the change of that change, bound it. Noise is learned, too; the share of it that a sample
teaches bounds that. The predictions of both models have no noise, so that their difference tells at
once whether they differ by more.
"""

from collections import deque
from math import isfinite, nan, sqrt
from typing import Final

import numpy as np

from piezod.control.law.model import StageModel
from piezod.control.signals import RecentRange
from piezod.hysteresis import LearnedModel, ModelForm
from piezod.hysteresis.adaptation import Adaptable, AdaptiveIdentifier
from piezod.hysteresis.covariance import MEASUREMENT_VARIANCE
from piezod.hysteresis.memory import Memory
from piezod.units import NS_PER_S

_LEVELS = 9
"""Displacements on each branch. Between them, just after the turn, the difference may be larger, by
a few percent of the range."""
LOOK_NS: Final = NS_PER_S // 50
"""Interval between two measurements of the difference, which takes 10 to 20 µs."""
MEAN_NS: Final = 5 * NS_PER_S
"""Time constant of the mean difference: motion soon corrects what a disturbance has taught."""
LEAST_ERROR: Final = 0.01
"""A learned model with an rms error up to this share of the range is never worse."""
TOLERANCE: Final = 2.0
"""Ratio of the mean squared errors above which the learned model is worse."""
FEWEST, MOST = 3, 8
"""Windows that a judgement needs, and the newest that count."""
USE_STANDARD_ERRORS: Final = 2.0
LEAST_MORE: Final = 2e-4**2
"""A mean squared error that is larger by less, in units of the range squared, makes no
difference."""

UNKNOWN_LAG_CYCLES: Final = 0.1
"""Lag of samples that nobody knows: by so much the delays of simulated stages change from 5 to
20 Hz."""
CLEARLY: Final = 2.0
"""A difference whose mean square is larger by this factor is not that of lag or noise."""


class ModelDrift:
    """Compares learned models with the identified one. Real-time safe."""

    def __init__(self, model: StageModel) -> None:
        rise = np.linspace(0.0, 1.0, _LEVELS)
        self._loop = model.form.loop(np.concatenate((rise, rise[-2::-1])))
        self._identified = self._loop.of(LearnedModel(model.weights)).copy()

    def measure(self, learned: Adaptable | LearnedModel) -> float:
        """Return the largest difference of the drives, as a share of the range.

        Takes 10 to 20 µs.

        Args:
            learned: What was learned; finite.
        """
        drives = self._loop.of(learned)
        np.subtract(drives, self._identified, out=drives)
        np.abs(drives, out=drives)
        return float(drives.max())


class LearnedBound:
    """Keeps a learned model within a distance of the identified one. Real-time safe.

    Args:
        model: The identified model.
        adaptation: What learns; it starts from the weights of the model.
        limit: Largest distance, as a share of the range.
        period_ns: Period of the loop, in ns.
    """

    def __init__(
        self, model: StageModel, adaptation: AdaptiveIdentifier, limit: float, period_ns: int
    ) -> None:
        self._adaptation, self._first = adaptation, LearnedModel(model.weights.copy())
        self._drift = ModelDrift(model)
        self._look_cycles = max(LOOK_NS // period_ns, 1)
        self._cycles, self._share = 0, min(self._look_cycles * period_ns / MEAN_NS, 1.0)
        self.limit = limit
        """Largest distance, as a share of the range."""
        self.distance = 0.0
        """Mean distance over some seconds, as a share of the range."""

    def update(self) -> None:
        """Look at the learned model now and then, and bring it back to the bound.

        Call once per cycle.
        """
        self._cycles += 1
        if self._cycles < self._look_cycles:
            return
        self._cycles = 0
        distance = self._limit(self._adaptation)
        self.distance += self._share * (min(distance, self.limit) - self.distance)

    def _limit(self, learned: AdaptiveIdentifier | LearnedModel) -> float:
        """Bring a learned model back to the bound; return how far it was."""
        if not is_finite(learned):  # a fault of its own, D2
            return 0.0
        distance = self._drift.measure(learned)
        if distance > self.limit:
            # The models that can be inverted are a convex set: each one on the way is in it.
            learned.approach(self._first, 1.0 - self.limit / distance)
        return distance

    def limited(self, learned: LearnedModel) -> LearnedModel:
        """Return a learned model, brought back to the bound if it is beyond it."""
        self._limit(learned)
        return learned

    def returned(self) -> None:
        """Note that the learned model is the identified one again."""
        self.distance = 0.0


def is_finite(learned: Adaptable | LearnedModel) -> bool:
    """Return whether all learned numbers are finite. Real-time safe."""
    # One NaN or infinity makes the sum not finite, too.
    return isfinite(float(learned.weights.sum()) + learned.offset + learned.scale)


class ModelErrors:
    """Errors of the identified and of the learned model, sample by sample. Real-time safe.

    Args:
        form: Form of both.
        first: The identified model; it may change in place.
        learned: What learns; its weights change in place.
        memory: Memory of the hysteresis at the start; None for a relaxed one.
        lag_known: Whether a response tells lag and modes, so that they explain no error.
    """

    def __init__(
        self,
        form: ModelForm,
        first: LearnedModel,
        learned: Adaptable,
        memory: Memory | None,
        *,
        lag_known: bool = False,
    ) -> None:
        self._lag_known = lag_known
        of_first, of_learned = form.past(first.weights), form.past(learned.weights)
        if memory is not None:
            of_first.take_over(memory)
            of_learned.take_over(memory)
        self._learned = learned
        self._step_first, self._step_learned = of_first.step, of_learned.step
        self._drive = self._position = nan
        self.learned = self.first = nan
        """Measured minus predicted displacement of both, in units of the range."""
        self.change = 0.0
        """Change of the drive since the sample before, normalised."""
        self.of_lag = 0.0
        """Square of what a lag that nobody knows may make of the displacement, in the same unit."""

    def follow(self, drive: float, position: float, crept: float) -> None:
        """Take a sample. Call once for each, also for one that is not valid.

        Args:
            drive: Drive that it answers, normalised.
            position: Displacement, with the zero of the model, normalised.
            crept: Part of it that creep and modes have added.
        """
        drive = 0.0 if drive < 0.0 else 1.0 if drive > 1.0 else drive
        change, again = drive - self._drive, position == self._position
        # A slow sensor tells a sample again: the drive has not stopped.
        if change == change and (change or not again):  # noqa: PLR0124 - not NaN
            bend, late = change - self.change, UNKNOWN_LAG_CYCLES * change
            self.change = change
            if not self._lag_known:
                self.of_lag = late * late + bend * bend
        self._drive, self._position = drive, position
        self.first = position - crept - self._step_first(drive)
        shown = self._step_learned(drive) + crept + self._learned.offset
        self.learned = position - shown / (1.0 + self._learned.scale)


class LearnedUse:
    """Judges a learned model over loops of the drive. Fixed memory. Real-time safe.

    Args:
        window_cycles: Number of samples between two judgements.
        learned_share: Share of its error that the model learns from a sample.
        unseen_lag_cycles: Largest lag that makes no difference, in cycles.
    """

    def __init__(
        self, window_cycles: int, learned_share: float = 0.0, unseen_lag_cycles: float = 0.0
    ) -> None:
        self._window_cycles, self._share = window_cycles, 1.0 / window_cycles
        self._learned_share, self._unseen_lag = learned_share, unseen_lag_cycles
        self._windows = deque[float](maxlen=MOST)
        self._sum, self._samples = 0.0, 0
        self.restart()

    def restart(self) -> None:
        """Use the learned model: it is the identified one again."""
        self.used = self._better = self._clear = True
        """Whether the learned model is used."""
        self._difference = self._late = self._moved = self._explained = 0.0
        self._begin()

    def add(
        self, error: float, first_error: float, of_lag: float, of_noise: float, change: float
    ) -> bool:
        """Take a sample in motion; return whether `used` has changed.

        Args:
            error: Error of the learned model before it has learned from the sample, in units of the
                range.
            first_error: Error of the identified model.
            of_lag: Square of what an unknown lag may make of the displacement.
            of_noise: Variance of the noise of the samples.
            change: Change of the drive since the sample before.
        """
        more = error * error - first_error * first_error
        if more - more != 0.0:  # not finite
            return False
        self._look(error - first_error, of_lag, of_noise, change)
        self._sum += more
        self._samples += 1
        if self._samples >= self._window_cycles:
            self._judge()
        before, self.used = self.used, self._better and self._clear
        return self.used is not before

    def _look(self, difference: float, of_lag: float, of_noise: float, change: float) -> None:
        """See whether the models differ by more than lag and noise explain."""
        share, lag = self._share, self._unseen_lag
        if of_noise > MEASUREMENT_VARIANCE:  # recursive least squares trusts such samples less
            of_noise = sqrt(of_noise * MEASUREMENT_VARIANCE)
        explained = of_lag + self._learned_share * of_noise
        self._explained += share * (explained - self._explained)
        self._difference += share * (difference * difference - self._difference)
        beyond = self._difference
        if lag:
            self._late += share * (difference * change - self._late)
            self._moved += share * (change * change - self._moved)
            # The lag that explains most of the difference, as far as it is allowed.
            lag = min(lag, abs(self._late) / self._moved) if self._moved else 0.0
            beyond += lag * (lag * self._moved - 2.0 * abs(self._late))
        least = self._explained if self._clear else CLEARLY * self._explained
        self._clear = self._explained <= LEAST_MORE or beyond > least

    def _judge(self) -> None:
        """Judge at the end of a window which model predicts better."""
        self._windows.append(self._sum / self._samples)
        self._sum, self._samples = 0.0, 0
        if len(self._windows) >= FEWEST and self._loses():
            self._better = not self._better
            self._begin()

    def _loses(self) -> bool:
        """Return whether the better model predicts worse than the other, and not by chance."""
        count, sign = len(self._windows), 1.0 if self._better else -1.0
        mean = sum(self._windows) / count
        variance = sum((each - mean) ** 2 for each in self._windows) / (count - 1)
        return sign * mean > USE_STANDARD_ERRORS * sqrt(variance / count) + LEAST_MORE

    def _begin(self) -> None:
        self._windows.clear()
        self._sum, self._samples = 0.0, 0


class ModelProof:
    """Keeps the last learned model that has proved itself. Fixed memory. Real-time safe.

    Over a window of cycles, the tracking error and the error of the first model alone are compared.
    If the learned model was not worse, the model from the start of the window is proven. If it was
    worse, the first model is the proven one again.

    Args:
        first: The model from the identification.
        window_cycles: Number of cycles between two comparisons.
        lag_cycles: An error that this many cycles of delay explain does not count.
        use: Judges whether the learned model is used at all; None for one without lag and noise.
    """

    def __init__(
        self,
        first: LearnedModel,
        window_cycles: int,
        lag_cycles: int,
        use: LearnedUse | None = None,
    ) -> None:
        self.first, self.proven = first, LearnedModel.of(first)
        """The model from the identification, and the last model that has proved itself."""
        self._candidate = LearnedModel.of(first)  # in use at the start of the window
        self.use = use or LearnedUse(window_cycles)
        """Whether the learned model is used at all."""
        self._window_cycles = window_cycles
        self._command = RecentRange(lag_cycles + 1)
        self._cycles, self._squares, self._first_squares = 0, 0.0, 0.0
        self._verdict: tuple[float, float] | None = None

    def restart(self, first: LearnedModel) -> None:
        """Start again with another first model."""
        for model in (self.first, self.proven, self._candidate):
            model.assign(first)
        self.use.restart()
        self._begin_window()

    def add(self, command: float, error: float, first_error: float, in_use: Adaptable) -> bool:
        """Take one cycle; return whether a window has ended with a worse model in use.

        Args:
            command: Command, in units of the range.
            error: Command minus position at the instant of the sample, in units of the range.
            first_error: Drive minus its prediction by the first model, in units of the range. The
                slope of a model is near one, so this is an error of the position, too.
            in_use: The learned model in use.
        """
        if self._cycles == 0:
            self._candidate.assign(in_use)
        self._command.add(command)
        beyond_lag = max(abs(error) - self._command.swing, 0.0)
        self._squares += beyond_lag * beyond_lag
        self._first_squares += first_error * first_error
        self._cycles += 1
        return self._cycles >= self._window_cycles and self._compare()

    def take_verdict(self) -> tuple[float, float] | None:
        """Return the tracking error of a worse model and its limit, once; None if there was none.

        Both are rms over a window, in units of the range.
        """
        verdict, self._verdict = self._verdict, None
        return verdict

    def _compare(self) -> bool:
        """Judge the window that ends, and begin the next one; return whether it was worse."""
        square = self._squares / self._cycles
        limit = max(TOLERANCE * self._first_squares / self._cycles, LEAST_ERROR**2)
        worse = not square <= limit  # so that NaN is worse
        self.proven.assign(self.first if worse else self._candidate)
        if worse:
            self._verdict = sqrt(square), sqrt(limit)
        self._begin_window()
        return worse

    def _begin_window(self) -> None:
        self._cycles, self._squares, self._first_squares = 0, 0.0, 0.0
