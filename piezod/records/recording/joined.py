"""A recording in several files, as one."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezod.records.recording.reader import RecordedTelemetry

Columns = dict[str, NDArray[Any]]


def joined(files: Sequence[RecordedTelemetry]) -> RecordedTelemetry:
    """Return the contents of the files of one recording as that of a single file.

    Args:
        files: The whole files, in their order, at least one.
    """
    first = files[0]
    if len(files) == 1:
        return first
    starts = np.cumsum([0, *(each.cycles["t_s"].size for each in files)])
    gaps = [each.gaps + np.array([start, 0]) for each, start in zip(files, starts, strict=False)]
    return replace(
        first,
        lost=sum(each.lost for each in files),
        gaps=np.concatenate(gaps),
        cycles=_columns([each.cycles for each in files]),
        axes={axis: _columns([each.axes[axis] for each in files]) for axis in first.axes},
        weights={axis: _weights([each.weights[axis] for each in files]) for axis in first.weights},
        events=tuple(event for each in files for event in each.events),
        adopted=tuple(model for each in files for model in each.adopted),
    )


def _columns(parts: Sequence[Columns]) -> Columns:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _weights(parts: Sequence[Columns]) -> Columns:
    # Models of different files may have different numbers of weights.
    width = max(part["weights"].shape[1] for part in parts)
    padded = [
        part
        | {
            "weights": np.pad(
                part["weights"],
                ((0, 0), (0, width - part["weights"].shape[1])),
                constant_values=np.nan,
            )
        }
        for part in parts
    ]
    return _columns(padded)
