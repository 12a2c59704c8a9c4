"""A made-up stage in normalised units, whose hysteresis has an exact inverse model."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.control.law.creep import AT_REST, CreepState
from piezod.hysteresis import Creep, InverseMPI, ModelForm, StopForm, SurfaceForm, new_bank
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.everett import SIZE, surface
from piezod.hysteresis.path_relaxation import PathRelaxation
from tests.hysteresis.surfaces import drawn

Array = NDArray[np.float64]

LEFT = np.array([0.1, 0.3, 0.55, 0.8])
RIGHT = np.array([0.15, 0.4, 0.6, 0.9])
BANK = new_bank(LEFT, RIGHT)
FORM = StopForm(BANK)
WEIGHTS = np.array([0.01, 0.03, 0.04, 0.05, 0.02, 0.01, 0.03, 0.04])  # left stops first
CREEP = Creep(np.array([0.01, 0.02, 0.02]), 1.0 - np.exp(-1e-3 / np.array([0.03, 0.3, 3.0])))
"""5 % in total, for samples 1 ms apart."""


class Kind(NamedTuple):
    """A made-up hysteresis of some form."""

    form: ModelForm  #: Form of its model.
    weights: Array  #: Its weights.
    other: Array  #: Weights of another model of the same form.

    def compensator(
        self, mode: Mode, fade_cycles: int = 1, creep: CreepState = AT_REST
    ) -> Compensator:
        """Return a compensator of a stage with this hysteresis."""
        return Compensator(self.form, self.weights, mode=mode, fade_cycles=fade_cycles, creep=creep)

    def drives_for(self, positions: list[float] | Array) -> Array:
        """Return the drives that make displacements, from rest."""
        return self.form.drives_at(self.weights, np.asarray(positions, dtype=np.float64))

    def drives(
        self,
        subject: Compensator,
        commands: list[float] | Array,
        identified: Array | None = None,
    ) -> list[float]:
        """Return the drives of a compensator for commands, without limits.

        The identifier has the weights of this hysteresis, unless others are given.
        """
        followed = self.weights if identified is None else identified
        return [subject.step(float(command), 0.0, 1.0, followed) for command in commands]


def _surface(seed: int) -> Array:
    """Return a surface whose displacement is 1 at the drive 1."""
    coefficients = drawn(seed)
    return coefficients / surface(coefficients, 1.0, 0.0)[0]


STOPS = Kind(FORM, WEIGHTS, 1.6 * WEIGHTS)
SURFACE = Kind(SurfaceForm(), _surface(7), 0.5 * (_surface(7) + _surface(8)))


def _relaxing() -> Kind:
    """Return a surface with a part that relaxes along the path; its displacement is 1 at 1."""
    form = SurfaceForm(path=PathRelaxation(-0.1, 2.0, 0.1))
    rise = 1.0 - form.rise(np.zeros(SIZE))
    return Kind(form, rise * _surface(3), rise * 0.5 * (_surface(3) + _surface(17)))


RELAXING = _relaxing()
LINE = Kind(RELAXING.form, RELAXING.form.straight_line(), RELAXING.other)
"""A line with the same part: at a rest inside the range only that has a past."""


def inverse() -> InverseMPI:
    """Return the inverse model of the stage in closed form."""
    return InverseMPI(RIGHT, LEFT, WEIGHTS[4:], WEIGHTS[:4], capacity=64)


class MadeUpStage:
    """A stage at rest that moves exactly as the inverse model and the creep predict."""

    def __init__(self, creep: Creep = CREEP, lags: Array | None = None, kind: Kind = STOPS) -> None:
        self._hysteresis = kind.form.stage(kind.weights)
        self._creep = creep
        self.lags = np.zeros(creep.weights.size) if lags is None else lags.copy()
        self._quick = 0.0

    def step(self, drive: float) -> float:
        """Return the displacement at a sample for the drive in force."""
        crept = advance_creep(self.lags, self._creep.gains, self._creep.weights, self._quick)
        self._quick = self._hysteresis.step(drive)
        return self._quick + crept


def wander(seconds: float) -> Array:
    """Return a displacement at 1 kHz, loops of many sizes within [0.1, 0.9], shape (n,)."""
    t_s = np.arange(0.0, seconds, 1e-3)
    swing = 0.3 + 0.1 * np.cos(0.7 * t_s)
    return 0.5 - swing * np.cos(2.0 * np.pi * t_s) + 0.05 * np.sin(3.1 * t_s) - 0.05


def compensator(mode: Mode, weights: Array = WEIGHTS, fade_cycles: int = 1) -> Compensator:
    """Return a compensator of the stage at rest, without creep."""
    return Compensator(FORM, weights, mode=mode, fade_cycles=fade_cycles)


def drives(
    subject: Compensator, commands: list[float] | Array, identified: Array = WEIGHTS
) -> list[float]:
    """Return the drives for commands without limits."""
    return [subject.step(command, 0.0, 1.0, identified) for command in commands]


def sine(seconds: float) -> Array:
    """Return a command of 0.5 Hz at 1 kHz whose amplitude grows and shrinks."""
    t = np.arange(0, seconds, 1e-3)
    return 0.5 - (0.5 - 0.2 * np.cos(0.3 * t)) * np.cos(np.pi * t) * 0.9
