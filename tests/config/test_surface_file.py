"""Model files of version 2: a surface, written and read without loss, and refused if broken."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.model_file import ModelFile, PathConfig, dump_model, load_model
from piezod.config.yaml_loader import parse_yaml
from piezod.control.law.model import StageModel
from piezod.control.law.model_files import read_model
from piezod.errors import ConfigError
from piezod.experiment.fit.model_io import model_fields
from piezod.hysteresis import AffineRange, SurfaceForm
from piezod.hysteresis.path_relaxation import PathRelaxation
from tests.config.test_model_file import MODEL
from tests.control.made_up import RELAXING, STOPS, SURFACE
from tests.hysteresis.surfaces import drawn

COEFFICIENTS = tuple(SURFACE.weights.tolist())
NO_STOPS: dict[str, Any] = {
    f"{side}_stop_{what}": () for side in ("right", "left") for what in ("thresholds", "weights")
}
FILE = ModelFile.model_validate(
    MODEL.model_dump()
    | NO_STOPS
    | {
        "version": 2,
        "method": "surface",
        "delay_s": -4.4e-4,
        "surface_coefficients": COEFFICIENTS,
    }
)


def changed(path: Path, **fields: object) -> Path:
    """Write a file with other fields, which are not checked."""
    path.write_text(dump_model(FILE.model_copy(update=fields)), encoding="utf-8")
    return path


def problem_of(path: Path) -> str:
    """Return the text with which a file is refused, without its path."""
    with pytest.raises(ConfigError) as caught:
        read_model(path)
    return str(caught.value).removeprefix(f"{path}:").strip()


def test_surface_is_restored_to_the_bit(tmp_path: Path) -> None:
    """Every number of a surface, and its negative delay, is the same after the text of a file."""
    model, file = read_model(changed(tmp_path / "m.yaml"))

    assert file == FILE
    assert isinstance(model.form, SurfaceForm)
    assert model.weights.tolist() == list(COEFFICIENTS)
    assert model.delay_s == -4.4e-4
    assert model.creep.weights.tolist() == list(MODEL.creep_weights)


def test_path_is_restored_to_the_bit(tmp_path: Path) -> None:
    """The part that relaxes along the path is the same after the text of a file."""
    path = PathConfig(weight=-0.1 / 3, decay=2.0 / 3, skew=0.1 / 3)
    model, file = read_model(changed(tmp_path / "m.yaml", surface_path=path))

    assert file.surface_path == path
    assert isinstance(model.form, SurfaceForm)
    assert model.form.path == PathRelaxation(-0.1 / 3, 2.0 / 3, 0.1 / 3)


@pytest.mark.parametrize(("exponent", "written"), [(1.0, None), (5.0 / 3, 5.0 / 3)])
def test_exponent_of_a_path_is_written_if_it_is_not_one(
    tmp_path: Path, exponent: float, written: float | None
) -> None:
    """So older programs read a file without it; after the text of a file it is the same."""
    form = SurfaceForm(path=PathRelaxation(-0.1 / 3, 2.0 / 3, 0.1 / 3, exponent))
    one = AffineRange(0.0, 1.0)
    fields = model_fields(StageModel(form, SURFACE.weights, one, one, 0.0))["surface_path"]
    model, _ = read_model(changed(tmp_path / "m.yaml", surface_path=fields))

    assert fields.exponent == written
    assert model.form == form


def test_file_without_a_path_is_one_of_older_programs() -> None:
    """Its key is only there if the model has the part, so that older programs read all others."""
    assert "surface_path" not in dump_model(FILE)


@given(seed=st.integers(0, 10_000))
def test_any_surface_round_trips(seed: int) -> None:
    """Any coefficients survive."""
    file = FILE.model_copy(update={"surface_coefficients": tuple(drawn(seed).tolist())})

    assert ModelFile.model_validate(parse_yaml(dump_model(file), "m").data) == file


def test_file_has_only_the_keys_of_its_version(tmp_path: Path) -> None:
    """The keys of stops are left out, and may be there if they are empty."""
    path = changed(tmp_path / "m.yaml")
    text = path.read_text(encoding="utf-8")
    path.write_text(text + "left_stop_weights: []\n", encoding="utf-8")

    assert "stop" not in text
    assert load_model(path) == FILE


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (
            {"surface_coefficients": COEFFICIENTS[:23]},
            "surface_coefficients: a file of version 2 has 24 surface_coefficients (got 23)",
        ),
        (
            {"surface_coefficients": ()},
            "a file of version 2 has 24 surface_coefficients (got 0)",
        ),
        (
            {"surface_coefficients": (*COEFFICIENTS[:23], float("nan"))},
            "surface_coefficients[23]: must be a number (got 'NaN'), allowed range -1000000 "
            "to 1000000",
        ),
        (
            {"left_stop_thresholds": (0.5,), "left_stop_weights": (0.1,)},
            "left_stop_thresholds: a file of version 2 has no left_stop_thresholds",
        ),
        (
            {"version": 1},
            "surface_coefficients: a file of version 1 has 0 surface_coefficients (got 24)",
        ),
        (
            {"right_stop_weights": (0.1,)},
            "right_stop_weights: needs one entry for each threshold (got 1 for 0)",
        ),
        (
            {"version": 1, "surface_activation": 0.01},
            "surface_activation: a file of version 1 has no surface_activation",
        ),
        (
            {"version": 1, "surface_path": PathConfig(weight=-0.1, decay=2.0, skew=0.1)},
            "surface_path: a file of version 1 has no surface_path",
        ),
    ],
    ids=["few", "none", "nan", "stops", "version", "weights", "activation", "path"],
)
def test_broken_file_is_refused(tmp_path: Path, fields: dict[str, object], text: str) -> None:
    """The message states the key and what it needs."""
    assert text in problem_of(changed(tmp_path / "m.yaml", **fields))


def test_surface_that_is_not_monotone_is_refused(tmp_path: Path) -> None:
    """A drive against the command is of no use; the error names the remedy."""
    backwards = tuple((-SURFACE.weights).tolist())

    text = problem_of(changed(tmp_path / "m.yaml", surface_coefficients=backwards))

    assert text.startswith("the model is not monotone: its smallest slope is -")
    assert text.endswith("identify again")


def test_path_that_makes_a_surface_not_monotone_is_refused(tmp_path: Path) -> None:
    """The part that relaxes may take away more slope than the surface has."""
    path = PathConfig(weight=-2.0, decay=2.0, skew=0.0)

    text = problem_of(changed(tmp_path / "m.yaml", surface_path=path))

    assert text.startswith("the model is not monotone: its smallest slope is -")


def test_forms_agree_on_the_widest_loop() -> None:
    """Both branches of the widest loop are the drives for a rise and a fall, for all forms."""
    positions = np.linspace(0.0, 1.0, 11)
    for kind in (STOPS, SURFACE, RELAXING):
        rising, falling = kind.form.widest_loop(kind.weights, positions)
        there_and_back = kind.drives_for([*positions, *positions[::-1]])

        assert rising == pytest.approx(there_and_back[:11], abs=1e-12)
        assert falling == pytest.approx(there_and_back[11:][::-1], abs=1e-12)
