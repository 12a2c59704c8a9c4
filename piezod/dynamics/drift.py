"""Slow drift of a stage: what its plays have shown predicts the next one.

The record of a play at the time t shows the input w* that would have put the stage on its command.
In terms of b, the input that the model of the stage asks for, this is

    w*(t) = s(t) b + o(t) + what the model lacks, which does not change.

A gain that grows is a scale s that falls; a zero that drifts is an offset o. A correction by the
last record is late by one play. So each of them, v, is fitted by a line over the last plays, with
weights g = 1/σ² and a level of its own for each waveform, because what the model lacks differs
(bars are the weighted means of a waveform):

    rate = Σ g (t - t̄) (v - v̄) / Σ g (t - t̄)².

σ is the noise, and a share of the correction that the play asks for, because the response by which
that is found is wrong by some share. The variance of the rate is 1 / Σ g (t - t̄)² by σ, and χ²
times that by the misfits of v, where χ² is their sum of squares, in σ, per degree of freedom. A
rate that chance explains by either of them is taken for 0: a constant stage is left alone, and a
jump is no drift, because it misses the line. Creep and settling become slower, so the last two
plays may lower the rate. The next play at t + Δt takes

    w(t + Δt) = w(t) + λ (correction) + rate_s Δt b + rate_o Δt,

a learning law of second order in the two quantities that drift as a whole.

The first play of another waveform takes s b + o of the last one. What the model lacks is in s and
o, too. Of a small waveform it may be a large share, but it is about as many µm of a larger one: so
s - 1 is carried over to a larger waveform by the ratio of the swings, about the mean of the
smaller one.
"""

from typing import NamedTuple

import numpy as np

from piezod.dynamics.model import ComplexArray, FloatArray

SIGNIFICANT = 3.0
"""A rate counts above this many standard deviations that are known."""
STUDENT = (63.7, 9.92, 5.84, 4.60)
"""And above this many that the misfits show, for one to four degrees of freedom: Student's t, which
chance exceeds once in a hundred times."""
LAST = 2 + len(STUDENT)
"""Number of plays that a rate is fitted to: a drift need not be a line for longer."""
_ROUNDING = 1e-12
"""Smallest standard deviation of a value."""


class Estimate(NamedTuple):
    """A value and its standard deviation."""

    value: float
    sigma: float


class _Seen(NamedTuple):
    """What one play has shown."""

    t_s: float
    value: float
    weight: float
    waveform: int


class Trend:
    """A quantity of the stage that may drift.

    Args:
        value: Its value as long as no play has shown it.
    """

    def __init__(self, value: float) -> None:
        self._value, self._t_s = value, 0.0
        self._seen: list[_Seen] = []

    def saw(self, t_s: float, waveform: int, found: Estimate) -> None:
        """Take what a play at a time in s has shown."""
        self._value, self._t_s = found.value, t_s
        weight = 1.0 / max(found.sigma, _ROUNDING) ** 2
        self._seen.append(_Seen(t_s, found.value, weight, waveform))
        del self._seen[:-LAST]

    def at(self, t_s: float) -> float:
        """Return the value that is expected at a time in s."""
        return self._value + self.rate() * (t_s - self._t_s)

    def rate(self) -> float:
        """Return the rate per second; 0 if it is not significant."""
        waveforms = {each.waveform for each in self._seen}
        free = len(self._seen) - len(waveforms) - 1
        if free < 1:
            return 0.0
        t_s, value, weight, waveform = np.array(self._seen).T
        for one in waveforms:
            own = waveform == one
            t_s[own] -= np.average(t_s[own], weights=weight[own])
            value[own] -= np.average(value[own], weights=weight[own])
        spread = float(weight @ t_s**2)
        rate = float((weight * t_s) @ value) / spread
        misfit = float(weight @ (value - rate * t_s) ** 2) / free
        least = max(SIGNIFICANT, STUDENT[free - 1] * np.sqrt(misfit)) / np.sqrt(spread)
        return self._slowed(rate) if abs(rate) > least else 0.0

    def _slowed(self, rate: float) -> float:
        """Return the part of a rate that the last two plays show, if they are of one waveform."""
        *_, before, last = self._seen
        if before.waveform != last.waveform:
            return rate
        latest = (last.value - before.value) / (last.t_s - before.t_s)
        return rate * float(np.clip(latest / rate, 0.0, 1.0))


class Drift:
    """Scale and offset of the input of one axis over time."""

    def __init__(self) -> None:
        self._scale, self._offset = Trend(1.0), Trend(0.0)
        self._waveform, self._swing, self._mean = 0, 0.0, 0.0
        self._model: FloatArray = np.empty(0)

    def begin(self, t_s: float, model_input: FloatArray) -> FloatArray:
        """Begin another waveform at a time in s; return its first input, shape (n,).

        Args:
            t_s: Time of its first play, in s.
            model_input: (n,) input that the model of the stage asks for.
        """
        scale, offset = self._scale.at(t_s), self._offset.at(t_s)
        swing = float(np.ptp(model_input))
        carried = 1.0 + min(1.0, self._swing / swing) * (scale - 1.0)
        offset += (scale - carried) * self._mean
        self._waveform += 1
        self._model, self._swing, self._mean = model_input, swing, float(np.mean(model_input))
        return carried * model_input + offset

    def saw(
        self,
        t_s: float,
        model: ComplexArray,
        needed: ComplexArray,
        noise: FloatArray,
        doubt: FloatArray,
    ) -> None:
        """Take what a play of the present waveform has shown, as harmonics of the samples.

        Args:
            t_s: Time of the play, in s.
            model: (n // 2 + 1,) samples that are expected for the input of the model.
            needed: (n // 2 + 1,) those for the input that would have had no error.
            noise: (n // 2 + 1,) standard deviations of the samples.
            doubt: (n // 2 + 1,) amount by which `needed` may be wrong all together.
        """
        n, mean, moving = self._model.size, self._mean, model[1:]
        size = float(np.linalg.norm(moving))
        scale = float(np.vdot(moving, needed[1:]).real) / size**2
        noise_of_scale = float(np.linalg.norm(np.abs(moving) * noise[1:])) / np.sqrt(2.0) / size**2
        sigma = float(np.hypot(noise_of_scale, np.linalg.norm(doubt[1:]) / size))
        offset = float(needed[0].real) / n - scale * mean
        parts = noise[0] / n, doubt[0] / n, mean * sigma
        self._scale.saw(t_s, self._waveform, Estimate(scale, sigma))
        self._offset.saw(t_s, self._waveform, Estimate(offset, float(np.linalg.norm(parts))))

    @property
    def is_seen(self) -> bool:
        """Whether the scale or the offset drifts."""
        return bool(self._scale.rate() or self._offset.rate())

    def change(self, begin_s: float, end_s: float) -> FloatArray:
        """Return the change of the input from one time to another, shape (n,)."""
        return (end_s - begin_s) * (self._scale.rate() * self._model + self._offset.rate())
