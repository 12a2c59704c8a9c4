"""What a configuration may say about the simulated rig."""

from typing import Any, get_args

import numpy as np
import pytest
from pydantic import ValidationError

from piezod.plant.effects import EFFECTS
from piezod.plant.parameters import (
    AmplifierParameters,
    SensorParameters,
    StageParameters,
    quantities,
)
from piezod.plant.variants import VARIANTS
from piezod_drivers.simulated.options import Commissioned, Line, Options

SEED = np.random.SeedSequence(1)
PARTS: dict[str, type[Any]] = {
    "stage": StageParameters,
    "amplifier": AmplifierParameters,
    "sensor": SensorParameters,
}


def test_options_know_every_variant() -> None:
    """The names that the options take are those of the plant's table."""
    assert get_args(Options.model_fields["variant"].annotation) == tuple(VARIANTS)


def test_options_know_every_effect() -> None:
    """There is one switch for each effect, and each is on."""
    switches = Options().effects.model_dump()

    assert switches == dict.fromkeys(EFFECTS, True)


@pytest.mark.parametrize("part", PARTS)
def test_options_describe_every_parameter(part: str) -> None:
    """The schema has text, unit and bounds of each parameter of the plant."""
    definition = Options.model_json_schema()["$defs"][part.capitalize()]["properties"]

    assert list(definition) == list(quantities(PARTS[part]))
    for name, quantity in quantities(PARTS[part]).items():
        number = definition[name]["anyOf"][0]
        assert (number["minimum"], number["maximum"]) == (quantity.low, quantity.high)
        assert f"({quantity.unit or 'a number'})" in definition[name]["description"]


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("edge", ["low", "high"])
def test_bounds_of_parameters_belong_to_the_range(part: str, edge: str) -> None:
    """Each bound is taken, and what lies beyond it is refused."""
    for name, quantity in quantities(PARTS[part]).items():
        value = getattr(quantity, edge)
        beyond = value - 1e-6 * abs(value) - 1e-9 if edge == "low" else value * (1 + 1e-6) + 1e-9
        taken = Options.model_validate({part: {name: value}})

        assert getattr(getattr(taken.plant(SEED), part), name) == value
        with pytest.raises(ValidationError, match=name):
            Options.model_validate({part: {name: beyond}})


def test_given_values_are_exact_and_the_others_vary() -> None:
    """What is configured does not vary with the seed; its neighbours do not change."""
    plain = Options().plant(SEED).stage
    given = Options.model_validate({"stage": {"creep_per_decade": 0.02}}).plant(SEED).stage

    assert given.creep_per_decade == 0.02
    assert given.mode_hz == plain.mode_hz != VARIANTS["stack"].parameters.stage.mode_hz


def test_switched_off_effect_is_absent_from_the_plant() -> None:
    """A switch in the configuration reaches the plant."""
    plant = Options.model_validate({"effects": {"creep": False, "delay": False}}).plant(SEED)

    assert (plant.stage.creep_per_decade, plant.sensor.delay_s) == (0.0, 0.0)
    assert plant.stage.drift > 0


@pytest.mark.parametrize("variant", VARIANTS)
def test_variant_decides_about_the_calibration(variant: str) -> None:
    """Only the uncalibrated stack has to do with a straight line, unless the options say so."""
    expected = Line() if variant == "stack-uncalibrated" else Commissioned(residual_pct=0.05)
    chosen = Options.model_validate({"variant": variant, "calibration": {"kind": "line"}})

    assert Options.model_validate({"variant": variant}).known_curve() == expected
    assert chosen.known_curve() == Line()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"variant": "cantilever"}, "'stack', 'stack-uncalibrated', 'flexure' or 'afm'"),
        ({"effects": {"gravity": True}}, "Extra inputs"),
        ({"stage": {"mode_hz": float("inf")}}, "finite"),
        ({"sensor": {"gain": 2}}, "Extra inputs"),
        ({"calibration": {"kind": "guess"}}, "'commissioned', 'line', 'table'"),
        (
            {"calibration": {"kind": "table", "sensor_v": [1, 2], "position_um": [1, 2, 3]}},
            "the same number of values",
        ),
        (
            {"calibration": {"kind": "table", "sensor_v": [1, 3, 2], "position_um": [1, 2, 3]}},
            "strictly rising or strictly falling",
        ),
        ({"calibration": {"kind": "table", "sensor_v": [1], "position_um": [1]}}, "at least 2"),
    ],
)
def test_mistakes_are_refused(options: dict[str, Any], message: str) -> None:
    """A name, a value or a table that cannot be meant is refused with a reason."""
    with pytest.raises(ValidationError, match=message):
        Options.model_validate(options)


def test_options_do_not_change() -> None:
    """What was validated stays."""
    with pytest.raises(ValidationError, match="frozen"):
        Options().variant = "afm"
