"""Regressions of scikit-learn on turning points; imported by the worker only.

Networks on turning points follow from the fact that a hysteresis without dynamics depends on its
present input and the remaining turning points alone (I. Mayergoyz, "Mathematical models of
hysteresis", 1991; J. D. Wei and C. T. Sun, IEEE Trans. Syst. Man Cybern. B 30 (2000) 601).
"""

import warnings
from itertools import product
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from benchmarks.peers.method import FloatArray, Method, Predictor, Rows, Series, Setting
from benchmarks.peers.turning_points import turning_points

THRESHOLD = 0.003
"""Way back from an extremum that makes it a turning point, above the noise of the records."""
COUNTS = (1, 2, 4)
TURNS = ("last", "remaining")
"""All turning points, or those that larger loops have left."""


def features(positions: FloatArray, setting: Setting) -> FloatArray:
    """Return position, direction and turning points, shape (n, 2 + k)."""
    wipe = setting["turns"] == "remaining"
    turns = turning_points(positions, int(setting["k"]), THRESHOLD, wipe=wipe)
    return np.column_stack((positions, turns.direction, turns.last))


def fit_mlp(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Fit a multilayer perceptron with two hidden layers."""
    network = MLPRegressor(
        hidden_layer_sizes=(16, 16),
        activation="tanh",
        solver="lbfgs",  # far better here than adam, at the same duration
        alpha=float(setting["alpha"]),
        tol=1e-8,  # it would stop early otherwise
        max_iter=300,
        max_fun=20_000,
        random_state=0,
    )
    return _fitted(make_pipeline(StandardScaler(), network), series, used, setting)


def fit_boosting(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Fit gradient-boosted trees."""
    trees = HistGradientBoostingRegressor(
        max_iter=300,
        learning_rate=0.1,
        max_leaf_nodes=int(setting["leaves"]),
        random_state=0,
    )
    return _fitted(trees, series, used, setting)


def _fitted(regressor: Any, series: Series, used: Rows, setting: Setting) -> Predictor:
    # The deviation from a straight line is smaller than the drive, and learned more precisely.
    deviations = (series.drives - series.positions)[used]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # the number of iterations is a setting
        regressor.fit(features(series.positions, setting)[used], deviations)

    def predict(positions: FloatArray) -> FloatArray:
        return np.asarray(positions + regressor.predict(features(positions, setting)))

    return predict


MLP_METHOD = Method(
    "MLP",
    "",
    fit_mlp,
    tuple(
        {"k": k, "turns": turns, "alpha": alpha}
        for k, turns, alpha in product(COUNTS, TURNS, (0.001, 0.03))
    ),
    search_stride=4,
)
BOOSTING_METHOD = Method(
    "gradient boosting",
    "",
    fit_boosting,
    tuple(
        {"k": k, "turns": turns, "leaves": leaves}
        for k, turns, leaves in product(COUNTS, TURNS, (15, 63))
    ),
    search_stride=4,
)
