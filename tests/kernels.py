"""Compile the kernels: `python -m tests.kernels`.

A kernel takes up to seconds to compile, and all workers of a test run need it at about the same
time. They load it from numba's cache if one process has compiled it before.
"""

import numpy as np

from piezod.control.reference.preview import PreviewedReference
from piezod.control.warm_up import warm_up
from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.preview import preview_filter
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.settings import FitSettings
from piezod.hysteresis import LSPO, LMSIdentifier, RLSIdentifier, StopForm, SurfaceForm
from piezod.hysteresis.surface_form import branch_slopes
from piezod.plant.effects import EFFECTS, without
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS
from tests.control.rig_stage import RigStage, shipped_config
from tests.experiment.made_up import record_of
from tests.experiment.made_up_surface import surface_record

MS_NS = 1_000_000


def fits() -> None:
    """Compile what a fit needs; some tests fit a record while they are collected."""
    surface, stops = surface_record(duration_s=10.0, creep=0.01), record_of(duration_s=10.0)
    for method in Method:
        record = surface if method is Method.SURFACE else stops
        creep = method is not Method.LMS
        fit_model(record, FitSettings(method=method, order=4, creep=creep, delay_s=0.0))
    drives = np.linspace(0.0, 1.0, 10)
    branch_slopes(SurfaceForm().straight_line(), drives, SurfaceForm())


def identifiers() -> None:
    """Compile the steps of the identifiers that `warm_up` does not run, and the operators."""
    stops = StopForm.even(2)
    LMSIdentifier(stops.bank).step(0.5, 0.5)
    RLSIdentifier(stops.bank, stops.straight_line()).run([0.5], [0.5])
    LSPO(0.5).step(0.5)


def previews() -> None:
    """Compile the filter of references that are known ahead."""
    stage = ResponseModel(0.0, (Resonance(734.0, 0.03),))
    reference = PreviewedReference(preview_filter(stage, 1e-3), 1e-3)
    reference.follow(lambda t_s: t_s, moving=False)
    reference.value(0.0)


def rigs() -> None:
    """Compile the simulated stage, alone and below a controller."""
    RigStage().run(0.01)
    for absent in ((), EFFECTS):
        plant = Plant(without(VARIANTS["stack"].parameters, absent), np.random.SeedSequence(1))
        plant.command(1.0)
        plant.advance_to(MS_NS)
        plant.ideal_reading_v(1.0)


if __name__ == "__main__":
    fits()
    warm_up(shipped_config())
    identifiers()
    previews()
    rigs()
