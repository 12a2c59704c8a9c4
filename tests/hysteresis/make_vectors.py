"""Writes the outputs of the oracle to a file: `python -m tests.hysteresis.make_vectors`."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.hysteresis import oracle

FILE = Path(__file__).with_name("vectors.json")

SYMMETRIC = {
    "thresholds_right": [0.25, 0.5, 0.75],
    "thresholds_left": [0.25, 0.5, 0.75],
    "q_right": [0.1, 0.05, 0.08],
    "q_left": [0.1, 0.05, 0.08],
}
BOTH_SIGNS = {
    "thresholds_right": [0.1, 0.35, 0.8],
    "thresholds_left": [0.2, 0.6],
    "q_right": [0.2, -0.1, 0.06],
    "q_left": [-0.05, 0.15],
}
STOPS = {
    "thresholds_left": [0.2, 0.4, 0.9],
    "thresholds_right": [0.3, 0.5, 0.7],
    "a_left": [0.02, -0.03, 0.05],
    "a_right": [0.01, 0.04, -0.02],
}


def paths() -> dict[str, list[float]]:
    """Return inputs that visit every branch of the memory."""
    decay = 0.5 * 0.8 ** np.arange(14) * (-1.0) ** np.arange(14)
    return {
        "major": [*np.linspace(0, 1, 9), *np.linspace(0.9, 0, 7), 1.0],
        "nested": [0.0, 0.9, 0.2, 0.8, 0.3, 0.6, 0.4, 0.5, 0.65, 0.25, 0.85, 0.1, 0.95, 0.0],
        "first_partial": [0.1, 0.35, 0.05, 0.3, 0.1, 0.35, 0.6, 0.0],
        "start_inside": [0.7, 0.5, 0.9, 0.45, 1.0],
        "decaying": [*(0.5 + decay), 0.5, 0.9, 0.1],
        "tiny": [0.4, 0.4 - 1e-9, 0.4, 0.4 + 1e-9, 0.4, 0.4 - 2e-9, 0.5, 0.5 - 1e-9, 0.6, 0.2],
        "plateaus": [0.0, 0.0, 0.3, 0.3, 0.3, 0.1, 0.1, 0.3, 0.3, 1.0, 1.0, 0.6, 0.6],
    }


def vectors() -> dict[str, Any]:
    """Return inputs, and the outputs of two models and one inverse for them."""
    content: dict[str, Any] = {"inputs": {}, "models": [], "stops": {**STOPS, "z": {}}}
    for name, path in paths().items():
        content["inputs"][name] = [float(v) for v in path]
        content["stops"]["z"][name] = oracle.inverse(**STOPS, positions=path).tolist()
    for sides in (SYMMETRIC, BOTH_SIGNS):
        recorded: dict[str, Any] = {**sides, "x": {}, "depth": {}, "F_right": {}, "F_left": {}}
        recorded["smallest_slope"] = oracle.smallest_slope(oracle.Model(**sides))
        for name, path in paths().items():
            model = oracle.Model(**sides)
            rows = [
                (model.step(float(v)), model.depth, model.right[1].w, model.left[1].w) for v in path
            ]
            for key, column in zip(
                ("x", "depth", "F_right", "F_left"), zip(*rows, strict=True), strict=True
            ):
                recorded[key][name] = list(column)
        content["models"].append(recorded)
    return content


if __name__ == "__main__":
    FILE.write_text(json.dumps(vectors(), indent=1) + "\n")
