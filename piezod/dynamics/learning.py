"""Learning of a periodic command: from pass to pass the error of a record corrects the input.

A stage turns a periodic input w into samples y. Its response G from w to y is known for the
harmonics of the period, with a static gain of one, and S is the part of it that is the sensor's.
The samples of a stage that is exactly on its command r are S R, so that the error is E = S R - Y:

    W_0 = S R / G,    W_{i+1} = W_i + λ E_i / G,    mean: w_0 = r / static gain, w += e.

An error at a harmonic shrinks by the factor |1 - λ G' / G| per pass, if the true response is G'. It
is at most 1 - λ (1 - δ) if G is wrong by the share δ. So a harmonic is learned only if δ is small
enough for `SLOWEST`, and only while its error exceeds the noise. A stage may have a mode that G
does not have, so a harmonic is corrected in small steps until the stage has followed it. A scale
and an offset that drift from play to play are foreseen (`drift.py`). Source of the idea: S.
Arimoto, S. Kawamura, F. Miyazaki, "Bettering operation of robots by learning", J. Robotic Systems 1
(1984).
"""

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from piezod.dynamics.drift import Drift
from piezod.dynamics.harmonics import GAIN, Harmonics, Lines
from piezod.dynamics.model import ComplexArray, FloatArray

FOLLOWS = 0.5
"""A stage follows a harmonic if its motion is wrong by at most this share."""
CAREFUL = 1e-3
"""Largest amplitude by which a harmonic is corrected that the stage has not followed, as a share of
the swing: a mode that amplifies it a hundred times moves the stage by a tenth."""
SIGNIFICANT = 3.0
"""An error counts above this many standard deviations of the noise: one of 8000 by chance."""
GREW = 1.2
"""An error has grown if it exceeds the smallest one by this factor, and the noise."""
ALLOWED_GROWTHS = 2
"""At this number of growths learning stops."""
FALLS = 0.9
"""An error falls if it gets below this share of the smallest one within two passes."""
DOUBT = 0.1
"""Share of a correction by which it may be wrong, because the response is."""


class Stop(StrEnum):
    """Why learning has stopped."""

    AT_NOISE = "the error is at the noise of the record"
    SETTLED = "the error no longer falls"
    GREW = "the error grew twice"
    PASSES = "all passes are done"


class Average(NamedTuple):
    """The average of the periods of a record."""

    period: FloatArray  #: (n,) mean of all periods.
    spectrum: ComplexArray  #: (n // 2 + 1,) its harmonics, in units of the amplitude times n / 2.
    noise: FloatArray  #: (n // 2 + 1,) standard deviation of each harmonic, in the same unit.


def average_of(periods: FloatArray) -> Average:
    """Return the average of periods, shape (periods, n), of which there are at least two.

    The noise follows from differences of successive periods, so that a slow drift is not noise.
    """
    spectra = np.fft.rfft(periods, axis=1)
    power = np.mean(np.abs(np.diff(spectra, axis=0)) ** 2, axis=0) / 2.0
    return Average(
        np.mean(periods, axis=0), np.mean(spectra, axis=0), np.sqrt(power / len(periods))
    )


class Assessment(NamedTuple):
    """The error of a record; in the unit of the command."""

    #: (n,) samples of a stage that is exactly on its command, minus those of the record.
    error: FloatArray
    rms: float  #: Rms error without noise.
    noise: float  #: Rms noise of the harmonics that are learned.
    significant: int  #: Number of learned harmonics whose error exceeds the noise, with the mean.
    spectrum: ComplexArray  #: (n // 2 + 1,) harmonics of the error.
    sigma: FloatArray  #: (n // 2 + 1,) their standard deviations.
    #: (n // 2 + 1,) input that would remove the error of the significant ones.
    correction: ComplexArray


class _Tried(NamedTuple):
    """An input that was played, its error and correction, and which harmonics were followed."""

    t_s: float
    wanted: FloatArray
    error: ComplexArray
    correction: ComplexArray
    followed: Lines


class Learner:
    """Learns the input for one periodic command.

    Args:
        command: (n,) one period of the command.
        harmonics: What is known at its harmonics.
        passes: Largest number of corrections.
        static_gain: Mean displacement per mean input; it differs from one by the creep.
        first: (n,) first input; None for the command through the inverse response.
        drift: Drift of the stage, from plays of other commands; None if there are none.

    Attributes:
        best: (n,) input of the smallest error so far.
        best_pass: Number of corrections of that input.
    """

    def __init__(
        self,
        command: FloatArray,
        harmonics: Harmonics,
        passes: int,
        static_gain: float = 1.0,
        first: FloatArray | None = None,
        drift: Drift | None = None,
    ) -> None:
        self._size, self._harmonics, self._passes = command.size, harmonics, passes
        spectrum = np.fft.rfft(command)
        self._target = spectrum * harmonics.sensor
        # What is not known is not driven: a harmonic at a mode would be amplified.
        inverted = np.where(harmonics.learned, self._target / harmonics.response, 0.0)
        inverted[0] = spectrum[0] / static_gain
        self._model_input, self._first = self._period(inverted), first
        self._drift = drift or Drift()
        self.best_pass = 0
        self._rms: list[float] = []  # of each pass so far
        self._gain, self._growths, self._foreseen = GAIN, 0, False
        self._largest = CAREFUL * float(np.ptp(command)) * self._size / 2.0
        self._step = np.zeros_like(self._target)  # the last change of the input
        self._t_s, self._wanted = 0.0, self._model_input
        self.best = self._wanted
        # The next input is that of `_base` plus a step towards its correction.
        none = self._step
        self._base = self._best = _Tried(0.0, self._wanted, none, none, harmonics.learned)

    @property
    def target(self) -> FloatArray:
        """Samples of a stage that is exactly on its command, shape (n,)."""
        return self._period(self._target)

    def expected(self, wanted: FloatArray) -> FloatArray:
        """Return the samples that the response expects for an input, shape (n,)."""
        return self._period(self._expected(wanted))

    def assess(self, average: Average) -> Assessment:
        """Return the error of a record, and its correction."""
        error = self._target - average.spectrum
        learned = self._harmonics.learned
        significant = learned & (np.abs(error) > SIGNIFICANT * average.noise)
        return Assessment(
            self._period(error),
            self._rms_of(np.maximum(np.abs(error) ** 2 - average.noise**2, 0.0)),
            self._rms_of(np.where(learned, average.noise**2, 0.0)),
            int(np.count_nonzero(significant)),
            error,
            average.noise,
            np.where(significant, error / self._harmonics.response, 0.0),
        )

    def next(self, t_s: float) -> FloatArray:
        """Return the input of the next play, which begins at a time in s, shape (n,)."""
        if self._rms:
            self._correct(t_s)
        else:
            carried = self._drift.begin(t_s, self._model_input)
            self._wanted = carried if self._first is None else self._first
        self._t_s, self._foreseen = t_s, self._drift.is_seen
        return self._wanted

    def take(self, found: Assessment) -> Stop | None:
        """Take the error of the last play; return why learning stops, None if it goes on."""
        smallest = min(self._rms, default=np.inf)
        followed = self._followed(found.spectrum)
        self._base = _Tried(self._t_s, self._wanted, found.spectrum, found.correction, followed)
        model, wanted = (self._expected(each) for each in (self._model_input, self._wanted))
        doubt = DOUBT * np.where(found.correction != 0.0, np.abs(found.spectrum), 0.0)
        self._drift.saw(self._t_s, model, wanted + found.spectrum, found.sigma, doubt)
        if found.rms < smallest:
            self.best, self.best_pass = self._wanted, len(self._rms)
            self._best = self._base
        elif found.rms > GREW * smallest + found.noise:
            self._growths += 1
            self._gain /= 2.0
            self._base = self._best
        self._rms.append(found.rms)
        return self._stop(found.significant)

    def _correct(self, t_s: float) -> None:
        step = self._gain * self._base.correction
        step[0] = self._base.correction[0]
        too_large = np.maximum(np.abs(step) / self._largest, 1.0)
        self._step = np.where(self._base.followed, step, step / too_large)
        drifted = self._drift.change(self._base.t_s, t_s)
        self._wanted = self._base.wanted + self._period(self._step) + drifted

    def _followed(self, error: ComplexArray) -> Lines:
        """Return which harmonics the stage has followed in the last play, with the mean."""
        if self._rms:
            meant = self._harmonics.response * self._step
            missed = error - (self._base.error - meant)
        else:
            meant, missed = self._target, error
        followed = np.abs(missed) <= FOLLOWS * np.abs(meant)
        followed[0] = True  # no mode amplifies the mean
        return np.asarray(followed)

    def _stop(self, significant: int) -> Stop | None:
        if not significant:
            return Stop.AT_NOISE
        if self._growths == ALLOWED_GROWTHS:
            return Stop.GREW
        before, last = self._rms[:-2], self._rms[-2:]
        # A drift that has been seen just now has not been foreseen yet: the error may fall.
        seen_anew = self._drift.is_seen and not self._foreseen
        if before and min(last) > FALLS * min(before) and not seen_anew:
            return Stop.SETTLED
        return Stop.PASSES if len(self._rms) > self._passes else None

    def _expected(self, wanted: FloatArray) -> ComplexArray:
        return np.asarray(np.fft.rfft(wanted) * self._harmonics.response)

    def _period(self, spectrum: ComplexArray) -> FloatArray:
        return np.fft.irfft(spectrum, self._size)

    def _rms_of(self, power: FloatArray) -> float:
        """Return the rms value of a period whose harmonics have these squared magnitudes."""
        shares = np.full(power.size, 2.0)
        shares[0] = 1.0
        if self._size % 2 == 0:
            shares[-1] = 1.0
        return float(np.sqrt(shares @ power)) / self._size
