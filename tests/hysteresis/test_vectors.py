"""Recorded numbers of this repository, and external reference vectors if they are available."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.hysteresis import LSPO, RSPO, InverseMPI, MPIModel
from tests.hysteresis import oracle
from tests.hysteresis.make_vectors import FILE, vectors

EXACT = 1e-12
RECORDED = json.loads(FILE.read_text())
NAMES = list(RECORDED["inputs"])


def model_of(recorded: dict[str, Any]) -> MPIModel:
    """Return the model of a record."""
    return MPIModel(
        recorded["thresholds_right"],
        recorded["q_right"],
        recorded["q_left"],
        left_thresholds=recorded["thresholds_left"],
    )


def stepped_depths(model: MPIModel, values: list[float]) -> list[int]:
    """Return the depth of the memory after each input."""
    depths = []
    for value in values:
        model.step(value)
        depths.append(model.depth)
    return depths


def assert_close(expected: Any, actual: Any) -> None:
    """Assert that numbers agree to 1e-12."""
    np.testing.assert_allclose(actual, expected, rtol=0, atol=EXACT)


def numbers(tree: Any) -> list[float]:
    """Return all numbers of nested lists and mappings, in order."""
    if isinstance(tree, dict):
        tree = list(tree.values())
    return [x for item in tree for x in numbers(item)] if isinstance(tree, list) else [tree]


def test_vectors_are_what_the_oracle_says() -> None:
    """The recorded numbers are the present outputs of the oracle."""
    assert_close(numbers(RECORDED), numbers(vectors()))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("recorded", RECORDED["models"], ids=["symmetric", "both_signs"])
def test_model_gives_the_recorded_numbers(recorded: dict[str, Any], name: str) -> None:
    """Output and depth of the memory equal those of the oracle at every sample."""
    values = RECORDED["inputs"][name]

    assert_close(recorded["x"][name], model_of(recorded).run(values))
    assert recorded["depth"][name] == stepped_depths(model_of(recorded), values)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("recorded", RECORDED["models"], ids=["symmetric", "both_signs"])
def test_play_operators_give_the_recorded_numbers(recorded: dict[str, Any], name: str) -> None:
    """A right and a left play equal those of the oracle at every sample."""
    values = RECORDED["inputs"][name]

    right, left = RSPO(recorded["thresholds_right"][1]), LSPO(recorded["thresholds_left"][1])

    assert_close(recorded["F_right"][name], right.run(values))
    assert_close(recorded["F_left"][name], left.run(values))


@pytest.mark.parametrize("name", NAMES)
def test_inverse_of_stops_gives_the_recorded_numbers(name: str) -> None:
    """A sum of stops with given weights equals that of the oracle at every sample."""
    stops = RECORDED["stops"]
    inverse = InverseMPI(
        stops["thresholds_right"], stops["thresholds_left"], stops["a_right"], stops["a_left"]
    )

    assert_close(stops["z"][name], inverse.run(RECORDED["inputs"][name]))


@pytest.mark.parametrize("recorded", RECORDED["models"], ids=["symmetric", "both_signs"])
def test_smallest_slope_is_the_recorded_number(recorded: dict[str, Any]) -> None:
    """The formula gives the smallest slope that the oracle found by trial."""
    assert_close(recorded["smallest_slope"], model_of(recorded).smallest_slope)


@pytest.fixture(scope="session")
def reference(shared_data: Path) -> Path:
    """Return the folder with the reference vectors of an independent implementation."""
    return shared_data / "reference"


@pytest.fixture(scope="session")
def paper(reference: Path) -> dict[str, Any]:
    """Return vectors of the paper's model with 19 thresholds on each side."""
    content: dict[str, Any] = json.loads((reference / "mpi_vectors.json").read_text())
    return content


@pytest.fixture(scope="session")
def exact(reference: Path) -> list[dict[str, Any]]:
    """Return vectors of models whose sides differ, with weights of either sign."""
    content: list[dict[str, Any]] = json.loads((reference / "exact_vectors.json").read_text())[
        "models"
    ]
    return content


def paper_model(paper: dict[str, Any]) -> MPIModel:
    """Return the model of the paper's vectors."""
    return MPIModel(paper["thresholds"], paper["q_right"], paper["q_left"])


def test_forward_model_agrees_with_the_reference(paper: dict[str, Any]) -> None:
    """On every input x equals the reference to 1e-12."""
    for name, values in paper["inputs"].items():
        assert_close(paper["expected"][name]["x"], paper_model(paper).run(values))


def test_single_operators_agree_with_the_reference(paper: dict[str, Any]) -> None:
    """On every input the plays equal the reference to 1e-12."""
    for name, values in paper["inputs"].items():
        for row, index in enumerate(paper["operators"]):
            r = paper["thresholds"][index]
            expected = paper["expected"][name]
            assert_close(np.transpose(expected["F_right"])[row], RSPO(r).run(values))
            assert_close(np.transpose(expected["F_left"])[row], LSPO(r).run(values))


def test_analytic_inverse_agrees_with_the_reference(paper: dict[str, Any]) -> None:
    """Thresholds, weights and output of the stops equal those of the reference."""
    inverse, expected = paper_model(paper).inverse(), paper["analytic_inverse"]

    assert_close(expected["r_left_stop"], inverse.left_stop_thresholds)
    assert_close(expected["a_left"], inverse.left_stop_weights)
    assert_close(expected["r_right_stop"], inverse.right_stop_thresholds)
    assert_close(expected["a_right"], inverse.right_stop_weights)
    for recorded in paper["expected"].values():
        assert_close(recorded["z"], paper_model(paper).inverse().run(recorded["x"]))


def test_models_with_two_sides_agree_with_the_reference(exact: list[dict[str, Any]]) -> None:
    """Output, depth, smallest slope and exact inverse equal those of the reference."""
    for recorded in exact:
        values = recorded["inputs"]
        assert_close(recorded["x"], model_of(recorded).run(values))
        assert recorded["depth"] == stepped_depths(model_of(recorded), values)
        assert_close(recorded["smallest_slope"], model_of(recorded).smallest_slope)
        assert_close(values, model_of(recorded).exact_inverse().run(recorded["x"]))


def test_oracle_agrees_with_the_reference(
    paper: dict[str, Any], exact: list[dict[str, Any]]
) -> None:
    """The oracle, which replaces the reference if that is not available, agrees with it."""
    r, inverse = paper["thresholds"], paper["analytic_inverse"]
    for name, values in paper["inputs"].items():
        expected = paper["expected"][name]
        model = oracle.Model(r, r, paper["q_right"], paper["q_left"])
        assert_close(expected["x"], model.run(values))
        z = oracle.inverse(
            inverse["r_left_stop"],
            inverse["r_right_stop"],
            inverse["a_left"],
            inverse["a_right"],
            expected["x"],
        )
        assert_close(expected["z"], z)
    for recorded in exact:
        sides = ("thresholds_right", "thresholds_left", "q_right", "q_left")
        model = oracle.Model(*(recorded[side] for side in sides))
        assert_close(recorded["x"], model.run(recorded["inputs"]))
