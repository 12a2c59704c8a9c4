"""Tests of the parts of a displacement at a point of the search for a surface."""

import numpy as np
import pytest

from piezod.experiment.fit.surface.creep_regressors import lags_of, with_creep
from piezod.experiment.fit.surface.parameters import (
    ACTIVATION,
    COUNT,
    CREEP,
    DECAY,
    EXPONENT,
    OFFSET,
    PATH,
    PROMPT,
    SKEW,
)
from piezod.experiment.fit.surface.point import Point, SurfaceRecord
from piezod.hysteresis.everett import SIZE
from tests.experiment.made_up_surface import all_loops, made_up_surface

PERIOD_S = 0.01
WEIGHTS = np.linspace(0.002, 0.03, OFFSET - CREEP)


@pytest.fixture(scope="module")
def point() -> Point:
    """Return a point with creep, a lag with the rate and a path."""
    drives = np.clip(all_loops(PERIOD_S * np.arange(1000.0)), 0.0, 1.0)
    record = SurfaceRecord(
        drives_at=lambda _s: drives,
        positions=drives,
        period_s=PERIOD_S,
        before=0.1,
        counted=np.ones(drives.size, dtype=np.bool_),
    )
    parameters = np.zeros(COUNT)
    parameters[:SIZE], parameters[CREEP:OFFSET] = made_up_surface(), WEIGHTS
    parameters[[PROMPT, ACTIVATION]] = 0.3, 0.01
    parameters[[PATH, DECAY, SKEW, EXPONENT]] = -0.2, 2.0, 0.1, 1.5
    return Point.at(record, parameters)


@pytest.mark.parametrize("place", [ACTIVATION, DECAY, SKEW, EXPONENT])
def test_creep_follows_the_change_with_a_parameter_of_the_form(point: Point, place: int) -> None:
    """Creep is linear: the displacement changes by the change without creep, with its creep."""
    step = 1e-3
    there = Point.at(point.record, point.parameters + step * np.eye(COUNT)[place])

    changes = with_creep(point.quick_gradient(place, step)[:, np.newaxis], WEIGHTS, PERIOD_S)

    assert np.max(np.abs(changes)) > 1e-3
    assert changes[:, 0] == pytest.approx((there.predicted - point.predicted) / step, abs=1e-9)


def test_creep_of_a_column_is_the_sum_of_its_lags(point: Point) -> None:
    """All columns are followed together, and each one as if it were alone."""
    crept = with_creep(point.quick, WEIGHTS, PERIOD_S)

    for values, found in zip(point.quick.T, crept.T, strict=True):
        assert found == pytest.approx(values + lags_of(values, PERIOD_S) @ WEIGHTS, abs=1e-12)
