"""Published errors to compare with."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from piezod.records.experiment_result import Recording


@dataclass(frozen=True)
class Reference:
    """Published errors that ours should not exceed."""

    label: str  #: Their source, for people, as in "paper".
    values: Mapping[tuple[str, str], float]  #: Error by (case, mode), in the unit of the metrics.
    metrics: tuple[str, ...]  #: Names of the metrics to compare with them.
    #: Figure of the source by (case, mode), as in "Fig. 7".
    figures: Mapping[tuple[str, str], str] = field(default_factory=dict)

    def value(self, recording: Recording) -> float | None:
        """Return the error to compare a recording with; None if there is none."""
        return self.values.get((recording.case, recording.mode))

    def figure(self, recording: Recording) -> str:
        """Return which figure of the source shows this run, as in "Fig. 7 of the paper"; or ""."""
        name = self.figures.get((recording.case, recording.mode), "")
        return f"{name} of the {self.label}" if name else ""

    def limit(self, recording: Recording, metric: str) -> float | None:
        """Return the limit of a metric of a recording; None if there is none."""
        return self.value(recording) if metric in self.metrics else None


def is_missed(value: float, limit: float | None) -> bool:
    """Return whether an error exceeds its limit, is infinite, or is NaN although it has a limit.

    Args:
        value: The error.
        limit: Its limit; None if there is none.
    """
    if math.isnan(value):
        return limit is not None
    return math.isinf(value) or (limit is not None and value > limit)
