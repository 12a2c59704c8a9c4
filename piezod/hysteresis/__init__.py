"""Hysteresis: operators, forward and inverse models, identification and error metrics.

Every quantity is normalised to [0, 1]; volts, time, devices and files do not appear here. "The
paper" is Qiu, Jiang, Ji and Hu, "A Modified Prandtl-Ishlinskii Model and its Applications to
Inverse Control of Piezoelectric Actuators". `docs/mathematics.md` lists which function implements
which equation; a search for "eq. (16)" finds the functions of that equation.

From the bottom up: `memory` (the past extrema that still matter), `bank` (all play operators of a
model on one memory), `closed_form` (the model with fixed weights as two table look-ups), `slopes`
(the condition for an inverse). On these build `operators`, `model`, `thresholds`, `least_squares`
and the adaptive identifiers `lms`, `nlms` and `rls`. `forms` is how control and experiments see a
model, whatever its class. `metrics` computes the errors of a record.
"""

from piezod.hysteresis.adaptation import AdaptiveIdentifier, LearnedModel
from piezod.hysteresis.bank import new_bank
from piezod.hysteresis.creep import NO_CREEP, Creep, add_creep, remove_creep
from piezod.hysteresis.forms import ModelForm, SteppedStage, StopForm
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
from piezod.hysteresis.online import Shadowed
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
from piezod.hysteresis.thresholds import (
    even_thresholds,
    graded_thresholds,
    has_even_thresholds,
    placed_thresholds,
)

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
    "LearnedModel",
    "MPIModel",
    "ModelForm",
    "NLMSIdentifier",
    "RLSIdentifier",
    "Shadowed",
    "SteppedStage",
    "StopForm",
    "add_creep",
    "asymmetry",
    "even_thresholds",
    "graded_thresholds",
    "has_even_thresholds",
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
