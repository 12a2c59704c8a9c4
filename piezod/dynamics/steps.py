"""The answer to a step: predicted by a model, and averaged over the steps of a record."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from piezod.dynamics.model import Resonance, ResponseModel

FloatArray = npt.NDArray[np.float64]

_BEFORE, _AFTER = 5, 20
"""Samples for which the drive is constant before and after a step, at least."""
_RISE: Final = 3
"""Most samples over which a step may extend."""
_CONSTANT: Final = 1e-6
"""Changes below this share of the range of the drive count as none."""
_END_SHARE: Final = 0.2
"""The answer is normalised to its mean over this last part."""
_MOST_DAMPED: Final = 1.0 - 1e-9


class StepAnswer(NamedTuple):
    """The mean answer to the steps of a record."""

    t_s: FloatArray  #: (n,) time since the step, in s.
    answer: FloatArray  #: (n,) displacement, 0 before the step and 1 at the end.
    steps: int  #: Number of steps.


def predicted_step(model: ResponseModel, t_s: FloatArray) -> FloatArray:
    """Return the answer of a model to a step at time 0, with a static gain of one, shape (n,)."""
    since_s = np.maximum(t_s - model.delay_s, 0.0)
    if not model.resonances:
        return np.where(t_s >= model.delay_s, 1.0, 0.0)
    return np.asarray(sum(mode.share * _rise(mode, since_s) for mode in model.resonances))


def _rise(mode: Resonance, t_s: FloatArray) -> FloatArray:
    damping = min(mode.damping, _MOST_DAMPED)
    angular = 2.0 * np.pi * mode.frequency_hz * t_s
    ringing = angular * np.sqrt(1.0 - damping**2)
    turned = np.cos(ringing) + damping / np.sqrt(1.0 - damping**2) * np.sin(ringing)
    return np.asarray(1.0 - np.exp(-damping * angular) * turned)


def measured_steps(
    drive: FloatArray, position: FloatArray, rate_hz: float, longest_s: float
) -> StepAnswer | None:
    """Return the mean answer to the steps of a record; None if it has none.

    A step is a change within a few samples, between two times of constant drive.

    Args:
        drive: (n,) voltage in force when each sample was taken.
        position: (n,) displacement.
        rate_hz: Samples per second.
        longest_s: Longest time after a step, in s.
    """
    changes = np.flatnonzero(np.abs(np.diff(drive)) > _CONSTANT * max(np.ptp(drive), 1e-300))
    if not changes.size:
        return None
    groups = np.split(changes, np.flatnonzero(np.diff(changes) > _AFTER) + 1)
    begins = np.array([group[0] for group in groups])
    ends = np.array([group[-1] for group in groups])
    before = np.diff(begins, prepend=-1)
    after = np.append(begins[1:], drive.size - 1) - ends
    steps = np.flatnonzero((ends - begins < _RISE) & (before > _BEFORE) & (after > _AFTER))
    if not steps.size:
        return None
    length = min(int(after[steps].min()), round(longest_s * rate_hz))
    answers = []
    for begin in begins[steps]:
        start = position[begin - _BEFORE + 1 : begin + 1].mean()
        answer = position[begin + 1 : begin + 1 + length] - start
        answers.append(np.sign(drive[begin + 1 + _RISE] - drive[begin]) * answer)
    mean = np.mean(answers, axis=0)
    end = float(mean[-max(1, round(_END_SHARE * length)) :].mean())
    # A sample shows the voltage that was in force when it was taken, written a period before.
    t_s = (np.arange(length) + 1) / rate_hz
    return None if end == 0.0 else StepAnswer(t_s, mean / end, len(answers))
