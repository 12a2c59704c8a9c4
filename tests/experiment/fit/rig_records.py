"""Records of the simulated rig: several stages, each with a drive of several speeds."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from piezod.config.experiment import load_experiment
from piezod.devices import registry
from piezod.experiment.fit.record import Record
from piezod.experiment.virtual.stage import IN_FORCE_V, POSITION_UM, opened
from piezod.hysteresis.memory import FloatArray
from tests.experiment.beyond import EXPERIMENTS

RATE_HZ, DURATION_S, HIGH_V = 500.0, 8.0, 140.0
VARIANTS = ("stack", "afm", "preisach-asymmetric", "bouc-wen", "light-damping")


def _triangle(turns: float) -> float:
    return 1.0 - abs(2.0 * (turns % 1.0) - 1.0)


DRIVES: dict[str, Callable[[float], float]] = {
    "sine": lambda t_s: 0.5 - 0.5 * np.cos(2.0 * np.pi * 0.5 * t_s),
    "triangle": lambda t_s: _triangle(0.5 * t_s),
    "decaying": lambda t_s: np.exp(-t_s / 4.0) * (0.5 - 0.5 * np.cos(2.0 * np.pi * 0.7 * t_s)),
    "inner loops": lambda t_s: 0.5 * (_triangle(0.8 * t_s) + _triangle(0.15 * t_s)),
    "steps": lambda t_s: round(10.0 * _triangle(0.25 * t_s)) / 10.0,
}
"""Drives in [0, 1] over time."""
GRADUAL = tuple(name for name in DRIVES if name != "steps")


@lru_cache(maxsize=len(VARIANTS) * len(DRIVES))
def rig_record(variant: str, drive: str) -> Record:
    """Return the record of a variant of the rig."""
    config = load_experiment(EXPERIMENTS / "identify.yaml", registry)
    rig = config.devices["rig"]
    options = rig.options.model_copy(update={"variant": variant})
    devices = {"rig": rig.model_copy(update={"options": options})}
    config = config.model_copy(update={"rate_hz": RATE_HZ, "devices": devices})
    with opened(config, lambda _: None) as stage:
        stage.rest(0.5)
        trace = stage.open_loop([lambda t_s: HIGH_V * DRIVES[drive](t_s)], DURATION_S)[0]
    t_s: FloatArray = np.arange(trace.shape[0]) / RATE_HZ
    return Record(t_s, trace[:, IN_FORCE_V].copy(), trace[:, POSITION_UM].copy())
