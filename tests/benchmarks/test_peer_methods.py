"""Tests of the methods by others: each finds the model that made a record."""

import numpy as np
import pytest

from benchmarks.peers import bouc_wen, branches, plays
from benchmarks.peers.evaluation import blocks, evaluate, held_out_residuals
from benchmarks.peers.method import FloatArray, Method, Predictor, Rows, Series, Setting

CURVE = np.log([1.3, 0.8, 1.1])


def motion(count: int = 4000) -> FloatArray:
    """Return a motion over [0, 1] from 0 with loops of many sizes, shape (count,)."""
    t = np.arange(count) / count
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * 12.0 * t)
    return np.asarray(swing * (1.0 - 0.8 * t) + 0.3 * t)


def series_of(positions: FloatArray, drives: FloatArray) -> Series:
    """Return a record of which all samples count."""
    return Series(positions, drives, np.ones(positions.size, np.bool_))


def of_stops(positions: FloatArray) -> FloatArray:
    """Return the drive of ten plays with nonnegative weights and an offset."""
    weights = np.array([-0.05, 0.0, 0.7, *np.linspace(0.3, 0.05, 10)])
    return np.asarray(plays.regressors(positions, plays.even_radii(10)) @ weights)


def of_curved_stops(positions: FloatArray) -> FloatArray:
    """Return the drive of the same behind a curve of four pieces."""
    return of_stops(plays.curved(positions, CURVE))


def of_bouc_wen(positions: FloatArray) -> FloatArray:
    """Return the drive of a Bouc-Wen model with a cubic polynomial."""
    columns = bouc_wen.regressors(positions, np.log([9.0, 2.0, 1.4]))
    return np.asarray(columns @ [0.1, -0.3, 1.1, 0.02, 0.15])


def of_branches(positions: FloatArray) -> FloatArray:
    """Return the drive of two polynomials of degree 5."""
    columns, direction = branches.powers(positions, 0.01, 2)
    n_terms = columns.shape[1]
    rising, falling = np.linspace(0.5, -0.5, n_terms), np.linspace(-0.3, 0.4, n_terms)
    return np.where(direction > 0.0, columns @ rising, columns @ falling)


@pytest.mark.parametrize(
    ("method", "setting", "drives_of", "tolerance"),
    [
        (plays.CLASSICAL, {"plays": 10}, of_stops, 1e-6),
        # Their parameters are searched, until the error hardly changes.
        (plays.KUHNEN, {"plays": 10, "pieces": 4}, of_curved_stops, 1e-5),
        (bouc_wen.BOUC_WEN, {"first n": 1}, of_bouc_wen, 1e-5),
        (branches.BRANCHES, {"threshold": 0.01, "turn degree": 2}, of_branches, 1e-6),
    ],
    ids=lambda value: value.name if isinstance(value, Method) else "",
)
@pytest.mark.few(2)
def test_a_method_reproduces_a_record_of_its_own_class(
    method: Method, setting: Setting, drives_of: Predictor, tolerance: float
) -> None:
    """It predicts the drive of the record, and that of another motion of the same model."""
    record = series_of(motion(), drives_of(motion()))
    other = 0.9 * motion(3000)

    predict = method.fit(record, record.counted, setting)

    assert predict(record.positions) == pytest.approx(record.drives, abs=tolerance)
    assert predict(other) == pytest.approx(drives_of(other), abs=tolerance)


def test_a_play_follows_with_its_radius() -> None:
    """A stop is the distance of the input from its play: up to the radius, in either direction."""
    outputs = np.empty((5, 1))

    plays.run_stops(np.array([0.0, 0.2, 1.0, 0.9, 0.0]), np.array([0.3]), outputs)

    assert outputs[:, 0] == pytest.approx([0.0, 0.2, 0.3, 0.2, -0.3])


def test_weights_of_a_classical_model_are_nonnegative() -> None:
    """If negative weights would fit best, the weights are 0."""
    columns = plays.regressors(motion(), plays.even_radii(3))

    weights = plays.nonnegative_weights(columns, columns @ [0.0, 0.0, 1.0, 0.2, -0.1, 0.2])

    assert weights.min() == 0.0


def test_curve_goes_from_0_to_1() -> None:
    """The curve of dead zones passes both corners, and rises with the given slopes."""
    curve = plays.curved(np.array([0.0, 0.1, 0.3, 0.4, 1.0]), CURVE)

    assert curve[[0, -1]] == pytest.approx([0.0, 1.0])
    assert (curve[3] - curve[2]) / (curve[1] - curve[0]) == pytest.approx(1.3)


def constant_fit(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Predict the mean of the samples in use, plus a setting."""
    mean = float(np.mean(series.drives[used])) + float(setting["offset"])
    return lambda positions: np.full(positions.size, mean)


CONSTANT = Method("constant", "", constant_fit, ({"offset": 0.5}, {"offset": 0.0}))


def test_a_block_is_predicted_from_the_others() -> None:
    """The block whose drive is 1 is predicted by the mean of the others, 0, and they by 0.25."""
    record = series_of(motion(100), np.repeat([0.0, 1.0, 0.0, 0.0, 0.0], 20))

    residuals = held_out_residuals(CONSTANT, record, {"offset": 0.0})

    assert residuals == pytest.approx(np.repeat([0.25, -1.0, 0.25, 0.25, 0.25], 20))


def test_blocks_leave_out_what_does_not_count() -> None:
    """The five blocks are contiguous, and have all samples that count, and no others."""
    counted = np.arange(103) >= 3

    assert np.concatenate(list(blocks(counted))).tolist() == list(range(3, 103))
    assert [block.size for block in blocks(counted)] == [20] * 5


def test_settings_are_chosen_on_held_out_blocks() -> None:
    """The better setting is taken, and its errors are in % of the range."""
    record = series_of(motion(100), np.repeat([0.0, 1.0, 0.0, 0.0, 0.0], 20))
    test = series_of(motion(100), np.full(100, 0.7))

    row = evaluate(CONSTANT, record, test, without_offset=False)
    centred = evaluate(CONSTANT, record, test, without_offset=True)

    assert row.setting == "offset 0.0"
    assert row.held_out_max_pct == pytest.approx(100.0)
    assert row.held_out_rms_pct == pytest.approx(100.0 * np.sqrt((1.0 + 4 * 0.25**2) / 5))
    assert (row.test_max_pct, row.test_rms_pct) == pytest.approx((50.0, 50.0))
    assert centred.test_max_pct == pytest.approx(0.0, abs=1e-9)
