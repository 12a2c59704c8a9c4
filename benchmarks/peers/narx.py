"""A polynomial NARX model of the inverse by sysidentpy; imported by the worker only."""

import warnings
from typing import Any

import numpy as np
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

from benchmarks.peers.method import FloatArray, Method, Predictor, Rows, Series, Setting


class GappedFROLS(FROLS):  # type: ignore[misc] # the library has no types
    """FROLS that fits to some rows of the regressors only, so that a block may be held out.

    Args:
        used: (n,) samples whose output is fitted to.
        options: As for FROLS.
    """

    def __init__(self, used: Rows, **options: Any) -> None:
        super().__init__(**options)
        self._used = used

    def run_mss_algorithm(self, psi: FloatArray, y: FloatArray, process_term_number: int) -> Any:
        """Return terms and regressors of the used rows, with their outputs for the last fit."""
        used = self._used[self.max_lag :]  # the first rows have no lagged values
        outputs = y[self.max_lag :][used]
        fitted = np.concatenate((y[: self.max_lag], outputs))
        return (*super().run_mss_algorithm(psi[used], fitted, process_term_number), outputs)


def inputs(positions: FloatArray) -> FloatArray:
    """Return displacement, its change, and the sign of the change, shape (n, 3).

    A NARX model has a hysteresis with these inputs (S. A. M. Martins and L. A. Aguirre, Mech. Syst.
    Signal Process. 75 (2016) 607).
    """
    change = np.diff(positions, prepend=positions[0])
    values = np.column_stack((positions, 100.0 * change, np.sign(change)))
    # The library has inputs with a lag of one or more only: so each is put one sample earlier.
    return np.concatenate((values[1:], values[-1:]))


def fit_narx(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Fit a polynomial NARX model to every `step`-th sample, because neighbours are too similar.

    The prediction runs freely on its own outputs, because a compensator has no others. It runs
    once from each of the first `step` samples, so that every sample is predicted.
    """
    step = int(setting["step"])
    lags = list(range(1, int(setting["lags"]) + 1))
    model = GappedFROLS(
        _whole_rows(used[::step], len(lags)),
        order_selection=False,
        n_terms=int(setting["terms"]),
        xlag=[lags, lags, lags],
        ylag=lags,
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=int(setting["degree"])),
    )
    model.fit(X=inputs(series.positions[::step]), y=series.drives[::step, np.newaxis])

    def predict(positions: FloatArray) -> FloatArray:
        # No drive is known at the start; both ranges are [0, 1].
        start = np.full((len(lags), 1), positions[0])
        drives = np.empty_like(positions)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # a model that diverges is reported as such
            for phase in range(step):
                predicted = model.predict(X=inputs(positions[phase::step]), y=start)
                drives[phase::step] = predicted.ravel()
        return drives

    return predict


def _whole_rows(used: Rows, lags: int) -> Rows:
    """Return the samples that are used and follow that many used samples, shape (n,)."""
    whole = used.copy()
    for lag in range(1, lags + 1):
        whole[lag:] &= used[:-lag]
        whole[:lag] = False
    return whole


NARX_METHOD = Method(
    "NARX",
    "",
    fit_narx,
    tuple(
        {"degree": degree, "lags": lags, "terms": terms, "step": step}
        for degree in (2, 3)
        for lags in (1, 2)
        for terms in (8, 16)
        for step in (4, 16, 48)
    ),
)
