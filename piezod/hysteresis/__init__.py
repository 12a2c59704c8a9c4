"""The mathematics of hysteresis: operators, forward and inverse models, identification, metrics.

Knows nothing of volts, time, devices and files: everything here is normalised. From the inside out:
`memory` (which past extrema matter), `bank` (all operators on it), `closed_form` (what fixed
weights make of them), `slopes` (whether they can be inverted), and on these `operators`, `model`,
`thresholds`, `least_squares` and the identifiers that adapt, `lms` to `rls`; `metrics` judges.
"""

from piezod.hysteresis.adaptation import AdaptiveIdentifier, Shadowed
from piezod.hysteresis.bank import new_bank
from piezod.hysteresis.creep import NO_CREEP, Creep, add_creep, remove_creep
from piezod.hysteresis.least_squares import (
    identify_least_squares,
    parameter_covariance,
    ridge_penalty,
    solve_constrained,
    stop_regressors,
)
from piezod.hysteresis.lms import Convergence, LMSIdentifier, largest_stable_gain
from piezod.hysteresis.metrics import (
    asymmetry,
    loop_width,
    nonlinearity,
    tracking_max,
    tracking_rms,
)
from piezod.hysteresis.model import ExactInverse, InverseMPI, MPIModel
from piezod.hysteresis.nlms import NLMSIdentifier
from piezod.hysteresis.normalisation import AffineRange
from piezod.hysteresis.operators import LSPO, LSSO, RSPO, RSSO
from piezod.hysteresis.rls import RLSIdentifier
from piezod.hysteresis.slopes import (
    LEAST_SLOPE,
    keep_invertible,
    projected,
    smallest_slope_of,
    to_slopes,
    to_weights,
)
from piezod.hysteresis.thresholds import even_thresholds, graded_thresholds, placed_thresholds

__all__ = [
    "LEAST_SLOPE",
    "LSPO",
    "LSSO",
    "NO_CREEP",
    "RSPO",
    "RSSO",
    "AdaptiveIdentifier",
    "AffineRange",
    "Convergence",
    "Creep",
    "ExactInverse",
    "InverseMPI",
    "LMSIdentifier",
    "MPIModel",
    "NLMSIdentifier",
    "RLSIdentifier",
    "Shadowed",
    "add_creep",
    "asymmetry",
    "even_thresholds",
    "graded_thresholds",
    "identify_least_squares",
    "keep_invertible",
    "largest_stable_gain",
    "loop_width",
    "new_bank",
    "nonlinearity",
    "parameter_covariance",
    "placed_thresholds",
    "projected",
    "remove_creep",
    "ridge_penalty",
    "smallest_slope_of",
    "solve_constrained",
    "stop_regressors",
    "to_slopes",
    "to_weights",
    "tracking_max",
    "tracking_rms",
]
