"""The work that `bench_hysteresis.py` measures: over an array, step by step, and in a cycle."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.hysteresis import (
    LMSIdentifier,
    MPIModel,
    NLMSIdentifier,
    RLSIdentifier,
    Shadowed,
    StopForm,
    SurfaceForm,
    SurfaceIdentifier,
    even_thresholds,
    new_bank,
)
from piezod.hysteresis.everett import N_MIDDLES, SIZE, surface
from piezod.hysteresis.path_relaxation import PathRelaxation
from piezod.jit import compiled

Array = NDArray[np.float64]

SAMPLES = 200_000
ORDER = 19  # operators on each side


@compiled
def classical_plays(
    inputs: Array, radii: Array, weights: Array, states: Array, outputs: Array
) -> None:
    """Sum classical play operators: the usual cost of a Prandtl-Ishlinskii model."""
    for k in range(inputs.size):
        total = 0.0
        for j in range(radii.size):
            states[j] = max(inputs[k] - radii[j], min(inputs[k] + radii[j], states[j]))
            total += weights[j] * states[j]
        outputs[k] = total


def command(count: int) -> Array:
    """Return a command of 0.5 Hz at 1 kHz with a varying amplitude."""
    t = np.arange(count) / 1000
    return 0.5 - 0.45 * np.cos(np.pi * t) * np.cos(0.08 * np.pi * t)


def model(order: int) -> MPIModel:
    """Return a model with loops of 13 % and its own weights on each side."""
    weights = 0.6 * np.exp(-0.12 * 19 * even_thresholds(order)) / order
    return MPIModel(even_thresholds(order), weights, 0.6 * weights)


def surface_weights() -> Array:
    """Return a surface with loops of 13 %."""
    coefficients = np.zeros(SIZE)
    coefficients[0], coefficients[N_MIDDLES], coefficients[1] = 0.75, 0.22, 0.05
    return coefficients / surface(coefficients, 1.0, 0.0)[0]


def relaxing_surface() -> tuple[SurfaceForm, Array]:
    """Return a surface with a part that relaxes along the path."""
    form = SurfaceForm(path=PathRelaxation(-0.1, 1.0, 0.0))
    rise = form.rise(np.zeros(SIZE))
    return form, (1.0 - rise) * surface_weights()


def arrays() -> dict[str, Callable[[], object]]:
    """Return the candidates that are measured over an array."""
    x = command(SAMPLES)
    plays = (even_thresholds(38) / 2, np.full(38, 1 / 60), np.zeros(38), np.empty_like(x))
    small, large = model(ORDER), model(200)
    bank = new_bank(even_thresholds(ORDER), even_thresholds(ORDER))
    lms = LMSIdentifier(bank)
    analytic, exact = small.inverse(), small.exact_inverse()
    form, coefficients = SurfaceForm(), surface_weights()
    relaxing, beside = relaxing_surface()
    return {
        "reference": lambda: classical_plays(x, *plays),
        "forward, M = 19": lambda: small.run(x),
        "forward, M = 200": lambda: large.run(x),
        "analytic inverse, M = 19": lambda: analytic.run(x),
        "exact inverse, M = 19": lambda: exact.run(x),
        "operators with LMS, M = 19": lambda: lms.run(x, x),
        "surface, forward": lambda: form.positions_at(coefficients, x),
        "surface, inverse": lambda: form.drives_at(coefficients, x),
        "surface with a path, forward": lambda: relaxing.positions_at(beside, x),
        "surface with a path, inverse": lambda: relaxing.drives_at(beside, x),
    }


def steps(count: int) -> dict[str, Callable[[], object]]:
    """Return the candidates that are measured step by step from Python."""
    commands = command(count).tolist()
    inverse = model(ORDER).inverse()
    bank = new_bank(inverse.left_stop_thresholds, inverse.right_stop_thresholds)
    weights = np.concatenate((inverse.left_stop_weights, inverse.right_stop_weights))
    form, lms, following = StopForm(bank), LMSIdentifier(bank), LMSIdentifier(bank)
    nlms, rls = NLMSIdentifier(bank), RLSIdentifier(bank, weights)
    by_mode = {mode: Compensator(form, weights, mode=mode, fade_cycles=1) for mode in Mode}
    both = Compensator(form, weights, mode=Mode.ADAPTIVE, fade_cycles=1)
    coefficients = surface_weights()
    smooth, learned = SurfaceIdentifier(coefficients), SurfaceIdentifier(coefficients)
    fixed, adapted = (
        Compensator(SurfaceForm(), coefficients, mode=mode, fade_cycles=1)
        for mode in (Mode.FEEDFORWARD, Mode.ADAPTIVE)
    )
    relaxing, beside = relaxing_surface()
    with_path = SurfaceIdentifier(beside, relaxing)
    both_with_path = Compensator(relaxing, beside, mode=Mode.ADAPTIVE, fade_cycles=1)

    def every(step: Callable[[float], object]) -> Callable[[], object]:
        def run() -> None:
            for value in commands:
                step(value)

        return run

    def compensate(one: Compensator) -> Callable[[], object]:
        return every(lambda value: one.step(value, 0.0, 1.0, weights))

    return {
        "inverse in closed form": every(inverse.step),
        **{f"compensator, {mode}": compensate(one) for mode, one in by_mode.items()},
        "LMS": every(lambda value: lms.step(value, value)),
        "normalised LMS": every(lambda value: nlms.step(value, value)),
        "RLS": every(lambda value: rls.step(value, value)),
        "compensate and adapt": every(
            lambda value: following.step(value, both.step(value, 0.0, 1.0, following.weights))
        ),
        "surface, compensator": every(lambda value: fixed.step(value, 0.0, 1.0, coefficients)),
        "surface, RLS": every(lambda value: smooth.step(value, value)),
        "surface, compensate and adapt": every(
            lambda value: learned.step(value, adapted.step(value, 0.0, 1.0, learned.weights))
        ),
        "the same, with a path": every(
            lambda value: with_path.step(
                value, both_with_path.step(value, 0.0, 1.0, with_path.weights)
            )
        ),
    }


def cycle_steps() -> dict[str, Callable[[float], object]]:
    """Return the reference, and the largest work of a cycle, for timing step by step."""
    one, out = np.zeros(1), np.zeros(1)
    plays = (even_thresholds(38) / 2, np.full(38, 1 / 60), np.zeros(38))
    exact = model(ORDER).exact_inverse()
    bank = new_bank(even_thresholds(ORDER), even_thresholds(ORDER))
    rls = RLSIdentifier(bank, np.zeros(2 * ORDER))
    exact_too, guarded = model(ORDER).exact_inverse(), Shadowed(RLSIdentifier(bank, rls.weights))

    def reference(value: float) -> None:
        one[0] = value
        classical_plays(one, *plays, out)

    return {
        "reference": reference,
        "exact inverse + RLS": lambda value: rls.step(value, exact.step(value)),
        "the same, with a shadow": lambda value: guarded.step(value, exact_too.step(value)),
    }
