"""Options of the simulated rig."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import ValidationError

from piezod.config.fields import Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import parse_yaml
from piezod.errors import ConfigError, DeviceError
from piezod.plant.effects import EFFECTS
from piezod.plant.laws import ThermalRelays
from piezod.plant.parameters import (
    AmplifierParameters,
    SensorParameters,
    StageParameters,
    quantities,
)
from piezod.plant.variants import VARIANTS
from piezod_drivers.simulated.options import Commissioned, SensorLine, SensorTable, SimulatedOptions

SEED = np.random.SeedSequence(1)
PARTS: dict[str, type[Any]] = {
    "stage": StageParameters,
    "amplifier": AmplifierParameters,
    "sensor": SensorParameters,
}
MODE_HZ = "allowed range 10 to 5000 Hz"


def read(text: str) -> SimulatedOptions:
    """Read options as from a file."""
    return validate(parse_yaml(text, "rig.yaml"), SimulatedOptions, Context())


def test_options_know_every_variant() -> None:
    """The options have the variants of the plant's table."""
    assert get_args(SimulatedOptions.model_fields["variant"].annotation) == tuple(VARIANTS)


def test_options_know_every_effect() -> None:
    """There is one switch for each effect, on by default."""
    switches = SimulatedOptions().effects.model_dump()

    assert switches == dict.fromkeys(EFFECTS, True)


@pytest.mark.parametrize("part", PARTS)
def test_options_describe_every_parameter(part: str) -> None:
    """The schema has text, unit and bounds of each parameter of the plant."""
    definition = SimulatedOptions.model_json_schema()["$defs"][part.capitalize()]["properties"]

    assert list(definition) == list(quantities(PARTS[part]))
    for name, quantity in quantities(PARTS[part]).items():
        number = definition[name]["anyOf"][0]
        assert (number["minimum"], number["maximum"]) == (quantity.low, quantity.high)
        assert f"({quantity.unit or 'a number'})" in definition[name]["description"]


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("edge", ["low", "high"])
def test_bounds_of_parameters_belong_to_the_range(part: str, edge: str) -> None:
    """Each bound is allowed; a value beyond it is refused with both bounds and the unit."""
    for name, quantity in quantities(PARTS[part]).items():
        value = getattr(quantity, edge)
        beyond = value - 1e-6 * abs(value) - 1e-9 if edge == "low" else value * (1 + 1e-6) + 1e-9
        taken = SimulatedOptions.model_validate({part: {name: value}})
        unit = f" {quantity.unit}" if quantity.unit else ""

        assert getattr(getattr(taken, part), name) == value
        with pytest.raises(ConfigError) as caught:
            read(f"{part}: {{{name}: {beyond!r}}}")
        assert str(caught.value) == (
            f"rig.yaml:1:{len(part) + len(name) + 6}: {part}.{name}: out of range (got {beyond!r}),"
            f" allowed range {quantity.low:.12g} to {quantity.high:.12g}{unit}"
        )


def test_given_values_are_exact_and_the_others_vary() -> None:
    """Configured values do not vary with the seed, and do not change other values."""
    plain = SimulatedOptions().plant(SEED).stage
    given = SimulatedOptions.model_validate({"stage": {"creep_per_decade": 0.02}}).plant(SEED).stage

    assert given.creep_per_decade == 0.02
    assert given.mode_hz == plain.mode_hz != VARIANTS["stack"].parameters.stage.mode_hz


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("edge", ["low", "high"])
def test_parameters_of_the_class_of_hysteresis_are_taken(variant: str, edge: str) -> None:
    """Each has its bounds, is exact, and leaves the others as the seed drew them."""
    drawn = SimulatedOptions.model_validate({"variant": variant}).plant(SEED)
    for name, quantity in quantities(type(drawn.hysteresis)).items():
        value = getattr(quantity, edge)
        options = {"variant": variant, "hysteresis": {name: value}}

        changed = replace(drawn.hysteresis, **{name: value})
        assert SimulatedOptions.model_validate(options).plant(SEED).hysteresis == changed


def test_class_of_hysteresis_has_its_schema() -> None:
    """The schema has text, unit and bounds of each parameter of each class."""
    definition = SimulatedOptions.model_json_schema()["$defs"]["Hysteresis"]["properties"]

    for name, quantity in quantities(ThermalRelays).items():
        number = definition[name]["anyOf"][0]
        assert (number["minimum"], number["maximum"]) == (quantity.low, quantity.high)
        assert quantity.about in definition[name]["description"]
    assert {"bias_spread", "beta", "pinning"} < definition.keys()


def test_switched_off_effect_is_absent_from_the_plant() -> None:
    """A switch in the configuration reaches the plant."""
    plant = SimulatedOptions.model_validate({"effects": {"creep": False, "delay": False}}).plant(
        SEED
    )

    assert (plant.stage.creep_per_decade, plant.sensor.delay_s) == (0.0, 0.0)
    assert plant.stage.drift > 0


@pytest.mark.parametrize("variant", VARIANTS)
def test_variant_decides_about_the_calibration(variant: str) -> None:
    """By default only the uncalibrated stack has a straight line as its curve."""
    residual_pct = {"bent-sensor": 0.3, "several-small": 0.1}.get(variant, 0.05)
    expected: Commissioned | SensorLine = Commissioned(residual_pct=residual_pct)
    if variant == "stack-uncalibrated":
        expected = SensorLine()
    chosen = SimulatedOptions.model_validate({"variant": variant, "calibration": {"kind": "line"}})

    assert SimulatedOptions.model_validate({"variant": variant}).known_curve() == expected
    assert chosen.known_curve() == SensorLine()


TABLE = "calibration: {kind: table, sensor_v: [1, 2], position_um: [0, 3]}"


@pytest.mark.parametrize(
    ("text", "place", "why"),
    [
        ("effects: {creep: yes}", "18: effects.creep", "true or false"),
        ("effects: {mode: 0}", "17: effects.mode", "true or false"),
        ('stage: {mode_hz: "500"}', "18: stage.mode_hz", "must be a number"),
        ("stage: {mode_hz: true}", "18: stage.mode_hz", "must be a number"),
        ("stage: {mode_hz: .inf}", "18: stage.mode_hz", MODE_HZ),
        ("variant: flexur", "10: variant", "did you mean 'flexure'"),
        ("variant: cantilever", "10: variant", "allowed: stack, stack-uncalibrated, flexure"),
        (
            "{variant: preisach-gaussian, stage: {exponent: 1.5}}",
            "48: stage.exponent",
            "leave it out",
        ),
        ("{variant: bouc-wen, stage: {skew: 0.5}}", "35: stage.skew", "has no skew"),
        ("{variant: bouc-wen, hysteresis: {activation: 0.005}}", "46: hyst", "has no activation"),
        ("hysteresis: {decay: 0.5}", "21: hysteresis.decay", "of 'stack' has no decay"),
        ("stage: {modehz: 5}", "9: stage.modehz", "did you mean 'mode_hz'"),
        ("effects: {delays: true}", "11: effects.delays", "did you mean 'delay'"),
        ("sensors: {}", "1: sensors", "did you mean 'sensor'"),
        ("calibration: {kind: guess}", "21: calibration.kind", "commissioned, line, table"),
        ("calibration: {kind: commissioned, residual_pct: 6}", "49: ", "0 to 5 %"),
        (TABLE.replace("[1, 2]", "[1]"), "38: calibration.sensor_v", "at least 2"),
        (TABLE.replace("[1, 2]", "1"), "38: calibration.sensor_v", "must be a list"),
        (TABLE.replace("[1, 2]", "[1, 200]"), "42: calibration.sensor_v[1]", "-100 to 100 V"),
        (TABLE.replace("[0, 3]", "[1, 2, 3]"), "59: calibration.position_um", "one for each"),
        (TABLE.replace("[1, 2]", "[1, 1]"), "38: calibration.sensor_v", "strictly rising"),
        (TABLE.replace("[0, 3]", "[3, 3]"), "59: calibration.position_um", "strictly rising"),
        (TABLE.replace("[1, 2]", "[1, 1.0000001]"), "38: calibration.sensor_v", "at least 1e-06 V"),
        ("stage: {reversible_um: 0, irreversible_um: 0}", "1: stage", "at least 0.01 µm"),
        ("amplifier: {dac_bits: 4, gain: 1000}", "1: amplifier", "at most 75 V"),
    ],
)
def test_mistakes_are_refused(text: str, place: str, why: str) -> None:
    """An invalid name, value or table is refused with place, reason and remedy."""
    with pytest.raises(ConfigError) as caught:
        read(text)
    assert str(caught.value).startswith(f"rig.yaml:1:{place}")
    assert why in str(caught.value)


def test_table_is_read_as_tuples() -> None:
    """Lists of a file become tuples, which cannot change."""
    table = read(TABLE).calibration

    assert isinstance(table, SensorTable)
    assert (table.sensor_v, table.position_um) == ((1.0, 2.0), (0.0, 3.0))


def test_switched_off_converter_may_be_coarse() -> None:
    """Rules only concern effects that are on."""
    options = read("{amplifier: {dac_bits: 4, gain: 1000}, effects: {dac: false}}")

    assert options.plant(SEED).amplifier.gain == 1000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sensor: {saturation_v: 0.5}", "saturated at rest: it outputs .* less than saturation_v"),
        ("stage: {reversible_um: 1000}", "saturated at rest"),
        ("sensor: {light_level: 0}", "does not resolve the travel: its output changes by 0 V"),
        ("sensor: {adc_bits: 4, adc_range_v: 100}", r"converter has steps of 12\.5 V"),
    ],
)
def test_sensor_without_resolution_is_refused(text: str, message: str) -> None:
    """A specimen whose sensor cannot measure the travel raises `DeviceError`."""
    with pytest.raises(DeviceError, match=message):
        read(text).plant(SEED)


def test_options_do_not_change() -> None:
    """Validated options cannot be changed."""
    with pytest.raises(ValidationError, match="frozen"):
        SimulatedOptions().variant = "afm"  # type: ignore[misc] # what the test is about
