"""Samples just after a stall of the loop: found, marked, and left out of the errors.

While the loop stands still, the amplifier holds its voltage and the command goes on. The error of
the first samples afterwards is that of the stall and not that of the compensation.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezod.control.law.identifier import LIMITED_CYCLES
from piezod.experiment.session.runs import LARGEST_SHARE, judged_errors_pct
from piezod.records.experiment_result import Recording

SETTLING_CYCLES: Final = LIMITED_CYCLES + 1
"""A stall marks this many samples; the identifier does not learn from the same ones."""


def late_indices(skipped: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of the samples just after a stall.

    Args:
        skipped: (n,) number of periods skipped by the loop until each sample.
    """
    firsts = 1 + np.flatnonzero(np.diff(skipped) > 0)
    marked = np.unique(np.add.outer(firsts, np.arange(SETTLING_CYCLES)))
    return marked[marked < skipped.size]


def late_note(recording: Recording, metrics: tuple[str, ...]) -> str:
    """Return how many samples were late and what they would have changed; empty if none was."""
    n_late, n_samples = recording.late_t_s.size, recording.t_s.size
    if not n_late:
        return ""
    if n_late > LARGEST_SHARE * n_samples:
        return (
            f"{n_late} of {n_samples} samples came just after a stall of the loop: too many to "
            "leave them out, so the errors contain them; lower rate_hz, or give the loop a "
            "processor and real-time priority."
        )
    with_late = judged_errors_pct(recording, metrics, with_late=True)
    changed = ", ".join(
        f"{name} {value:.3g} in place of {recording.metrics[name]:.3g}"
        for name, value in with_late.items()
        if f"{value:.3g}" != f"{recording.metrics[name]:.3g}"
    )
    return (
        f"{n_late} of {n_samples} samples came just after a stall of the loop and are left out of "
        f"the errors; with them: {changed or 'the same errors'}."
    )
