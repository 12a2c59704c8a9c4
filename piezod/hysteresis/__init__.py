"""The mathematics of hysteresis: operators, forward and inverse models, identification, metrics.

Knows nothing of volts, time, devices and files: everything here is normalised. From the inside out:
`memory` (which past extrema matter), `bank` (all operators on it), `closed_form` (what fixed
weights make of them), and on these `operators`, `model`, `lms`, `least_squares`; `metrics` judges.
"""

from piezod.hysteresis.bank import even_thresholds, new_bank
from piezod.hysteresis.creep import NO_CREEP, Creep, add_creep, remove_creep
from piezod.hysteresis.least_squares import identify_least_squares, stop_regressors
from piezod.hysteresis.lms import Convergence, LMSIdentifier, largest_stable_gain
from piezod.hysteresis.metrics import (
    asymmetry,
    loop_width,
    nonlinearity,
    tracking_max,
    tracking_rms,
)
from piezod.hysteresis.model import ExactInverse, InverseMPI, MPIModel
from piezod.hysteresis.normalisation import AffineRange
from piezod.hysteresis.operators import LSPO, LSSO, RSPO, RSSO

__all__ = [
    "LSPO",
    "LSSO",
    "NO_CREEP",
    "RSPO",
    "RSSO",
    "AffineRange",
    "Convergence",
    "Creep",
    "ExactInverse",
    "InverseMPI",
    "LMSIdentifier",
    "MPIModel",
    "add_creep",
    "asymmetry",
    "even_thresholds",
    "identify_least_squares",
    "largest_stable_gain",
    "loop_width",
    "new_bank",
    "nonlinearity",
    "remove_creep",
    "stop_regressors",
    "tracking_max",
    "tracking_rms",
]
