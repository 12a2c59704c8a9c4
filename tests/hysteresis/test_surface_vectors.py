"""Surfaces against recorded sums over all pairs of extrema, made with 50 decimal digits."""

import json
from typing import Any

import numpy as np
import pytest

from piezod.hysteresis.everett_memory import (
    advance_drive,
    displacement,
    displacement_beside,
    new_surface_memory,
)
from piezod.hysteresis.path_relaxation import PathRelaxation
from piezod.hysteresis.surface_form import SurfaceForm
from tests.hysteresis.make_surface_vectors import DRIVES, FILE, SURFACES, displacements, vectors
from tests.hysteresis.surfaces import Floats

EXACT = 1e-12
RECORDED = json.loads(FILE.read_text())
every_surface = pytest.mark.parametrize("name", list(RECORDED["surfaces"]))
every_path = pytest.mark.parametrize("path", list(RECORDED["drives"]))


class Vector:
    """A surface, drives from rest, and the displacements for them."""

    def __init__(self, name: str, path: str) -> None:
        surface: dict[str, Any] = RECORDED["surfaces"][name]
        lag = ("activation", "prompt_slope", "period_s")
        relaxing = PathRelaxation(**surface["path"]) if "path" in surface else None
        lagging = {key: surface[key] for key in lag if key in surface}
        self.form = SurfaceForm(**lagging, path=relaxing)
        self.coefficients: Floats = np.ravel(surface["coefficients"]).astype(np.float64)
        self.drives: Floats = np.array(RECORDED["drives"][path])
        self.displacements: Floats = np.array(surface["displacements"][path])


@pytest.mark.stress
def test_vectors_are_what_the_reference_says() -> None:
    """All recorded numbers are the present output of the reference, to the last bit."""
    assert vectors() == RECORDED


@every_surface
def test_one_drive_has_what_the_reference_says(name: str) -> None:
    """Each surface has the parameters and, for one drive, the displacements of the reference."""
    recorded, path = RECORDED["surfaces"][name], "wiped out"
    now = displacements(DRIVES[path], **SURFACES[name])

    assert RECORDED["drives"] == DRIVES
    assert RECORDED["surfaces"].keys() == SURFACES.keys()
    assert recorded == {**SURFACES[name], "displacements": {**recorded["displacements"], path: now}}


@every_path
@every_surface
def test_displacements_are_the_recorded_numbers(name: str, path: str) -> None:
    """At once and step by step, each displacement equals the sum over all pairs to 1e-12."""
    vector = Vector(name, path)
    stage = vector.form.stage(vector.coefficients)

    at_once = vector.form.positions_at(vector.coefficients, vector.drives)

    assert at_once == pytest.approx(vector.displacements, rel=0.0, abs=EXACT)
    assert [stage.step(drive) for drive in vector.drives.tolist()] == at_once.tolist()


@every_path
@every_surface
def test_regressors_give_the_recorded_numbers(name: str, path: str) -> None:
    """The memory of regressors, which adaptation uses, has the same displacements."""
    vector = Vector(name, path)
    memory, terms, found = new_surface_memory(), vector.form.terms, []
    for drive in vector.drives.tolist():
        advance_drive(memory, terms, 0.0, drive)
        slow = displacement(vector.coefficients, memory.now)
        found.append(slow + displacement_beside(memory, terms))

    assert found == pytest.approx(vector.displacements, rel=0.0, abs=EXACT)


@every_path
@every_surface
def test_inverse_returns_the_drives(name: str, path: str) -> None:
    """The recorded displacements give the drives that made them."""
    vector = Vector(name, path)

    inverted = vector.form.drives_at(vector.coefficients, vector.displacements)

    assert inverted == pytest.approx(vector.drives, rel=0.0, abs=EXACT)
