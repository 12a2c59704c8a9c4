"""Channels in a configuration: missing channels and wrong uses."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import pytest
from pydantic import BaseModel

from piezod.config.channels import (
    InputConfig,
    LightConfig,
    LineCalibration,
    OutputConfig,
    SensorConfig,
)
from piezod.config.daemon import DaemonConfig
from piezod.config.fields import ConfigModel, Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import parse_yaml
from piezod.errors import ConfigError

STAGE = """\
rate_hz: 1000
devices:
  daq: {driver: daq}
  gauge: {driver: gauge}
axes:
  x:
    sensor: {device: gauge, channel: out}
    amplifier: {device: daq, channel: DAC0}
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    command_range_um: [0, 26]
  y:
    sensor: {device: daq, channel: AIN0, calibration: {kind: line, gain: 4}}
    amplifier: {device: daq, channel: DAC1, calibration: {kind: line, gain: 15}}
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    command_range_um: [0, 26]
"""


class _Options(ConfigModel):
    port: str | None = None


class _Units(NamedTuple):
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]


class _Plugin(NamedTuple):
    options_model: type[BaseModel]
    channels: Callable[[Any], _Units | None]


UNITS = {
    "daq": _Units({"AIN0": "V", "AIN1": "V", "AIN2": "V"}, {"DAC0": "V", "DAC1": "V", "AO": "%"}),
    "gauge": _Units({"out": "µm"}, {}),
}


class _Drivers:
    def names(self) -> list[str]:
        return list(UNITS)

    def load(self, name: str) -> _Plugin:
        return _Plugin(_Options, lambda _options: UNITS[name])


def load(*replacements: tuple[str, str]) -> DaemonConfig:
    """Load the stage after replacing parts of its text."""
    text = STAGE
    for old, new in replacements:
        assert text.count(old) == 1, f"{old!r} must be there once"
        text = text.replace(old, new)
    return validate(parse_yaml(text, "test.yaml"), DaemonConfig, Context(drivers=_Drivers()))


def test_a_stage_whose_channels_are_there_is_right() -> None:
    """Channels are read from the file; a name alone means the channel with the name of the axis."""
    axes = load().axes

    assert axes["x"].sensor == SensorConfig(device="gauge", channel="out")
    assert axes["y"].amplifier == OutputConfig(
        device="daq", channel="DAC1", calibration=LineCalibration(gain=15.0)
    )


MISTAKES = [
    ("channel: AIN0", "channel: AIN99", "12:36: axes.y.sensor.channel: no such input"),
    ("channel: DAC0", "channel: gate", "8:39: axes.x.amplifier.channel: no such output"),
    (
        "sensor: {device: gauge, channel: out}",
        "sensor: gauge",
        "7:13: axes.x.sensor: no such input (got 'x')",
    ),
    (
        "{device: daq, channel: DAC0}",
        "{device: gauge, channel: out}",
        "8:41: axes.x.amplifier.channel: device gauge has no outputs: name another device",
    ),
    (
        "device: daq, channel: AIN0",
        "device: dac, channel: AIN0",
        "12:22: axes.y.sensor.device: no such device (got 'dac')",
    ),
    (
        ", calibration: {kind: line, gain: 4}",
        "",
        "12:5: axes.y.sensor: input AIN0 of daq is in V: give a `calibration:` from V to µm",
    ),
    (
        "channel: DAC0",
        "channel: AO",
        "8:5: axes.x.amplifier: output AO of daq is in %: give a `calibration:` from % to V at",
    ),
    (
        "channel: DAC1",
        "channel: DAC0",
        "13:5: axes.y.amplifier: output DAC0 of daq drives axis x already: an axis needs one of",
    ),
    (
        "gain: 4}}",
        "gain: 4}, light: {channel: out, nominal: 2, least: 1}}",
        "12:95: axes.y.sensor.light.channel: no such input (got 'out')",
    ),
    (
        "gain: 4}}",
        "gain: 4}, beside: [AIN1, AIN9]}",
        "12:93: axes.y.sensor.beside[1]: no such input (got 'AIN9')",
    ),
    (
        "{kind: line, gain: 15}",
        "{kind: table, values: [0, 10], physical: [0, 120]}",
        "14:43: axes.y.limits.drive_max_v: outside the calibration of the amplifier (got 150 V)",
    ),
    (
        "{kind: line, gain: 15}",
        "{kind: polynomial, coefficients: [0, 15, -1], values: [0, 10]}",
        "13:91: axes.y.amplifier.calibration.coefficients: must rise, or fall, everywhere from 0",
    ),
    (
        "{kind: line, gain: 4}",
        "{kind: table, values: [0, 2, 1], physical: [0, 10, 20]}",
        "12:77: axes.y.sensor.calibration.values: must be strictly rising or strictly falling",
    ),
    (
        "{kind: line, gain: 4}",
        "{kind: table, values: [0, 1, 2], physical: [0, 10, 20], side: far}",
        "12:117: axes.y.sensor.calibration.side: no values after the maximum",
    ),
    (
        "{kind: line, gain: 4}",
        "{kind: table, values: [0, 1, 0.5, 2], physical: [0, 10, 20, 30], side: near}",
        "12:77: axes.y.sensor.calibration.values: must be strictly rising before the maximum",
    ),
    (
        "    sensor: {device: daq, channel: AIN0",
        "    command_input: {device: daq, channel: knob}\n    sensor: {device: daq, channel: AIN0",
        "12:43: axes.y.command_input.channel: no such input (got 'knob')",
    ),
    (
        "    sensor: {device: daq, channel: AIN0",
        "    command_input: {device: daq, channel: AIN2}\n    sensor: {device: daq, channel: AIN0",
        "12:5: axes.y.command_input: input AIN2 of daq is in V: give a `calibration:` from V to",
    ),
]


@pytest.mark.parametrize(("old", "new", "problem"), MISTAKES)
def test_a_channel_that_cannot_be_used_is_refused(old: str, new: str, problem: str) -> None:
    """The message states the place, the problem and the remedy."""
    with pytest.raises(ConfigError) as caught:
        load((old, new))

    (found,) = map(str, caught.value.problems)
    assert found.startswith(f"test.yaml:{problem}")


def test_a_calibration_that_is_written_down_is_meant() -> None:
    """A calibration without effect is accepted: 1 V may be 1 µm."""
    sensor = load(("{kind: line, gain: 4}", "{kind: line}")).axes["y"].sensor

    assert sensor is not None
    assert sensor.calibration == LineCalibration()


def test_light_and_command_are_read_from_the_file() -> None:
    """All their keys are read."""
    light = "light: {channel: AIN1, nominal: 2, least: 1, divides: false}"
    axes = load(
        ("{kind: line, gain: 4}}", f"{{kind: line, gain: 4}}, {light}}}"),
        ("    sensor: {device: gauge", "    command_input: gauge\n    sensor: {device: gauge"),
        ("  x:\n", "  out:\n"),
    ).axes
    sensor = axes["y"].sensor

    assert sensor is not None
    assert sensor.light == LightConfig(channel="AIN1", nominal=2.0, least=1.0, divides=False)
    assert axes["out"].command_input == InputConfig(device="gauge")


def test_two_devices_cannot_have_one_port() -> None:
    """The error is reported for the second one, with the name of the first."""
    with pytest.raises(ConfigError, match=r"devices\.gauge\.options\.port: .* of device daq too"):
        load(
            ("daq: {driver: daq}", "daq: {driver: daq, options: {port: /dev/a}}"),
            ("gauge: {driver: gauge}", "gauge: {driver: gauge, options: {port: /dev/a}}"),
        )


NO_SENSOR = ("    sensor: {device: daq, channel: AIN0, calibration: {kind: line, gain: 4}}\n", "")


def test_axis_needs_no_sensor() -> None:
    """An amplifier alone is enough."""
    axes = load(NO_SENSOR).axes

    assert axes["y"].sensor is None
    assert [key for key, _ in axes["y"].channels()] == ["amplifier"]


def test_mode_that_needs_a_sensor_is_refused_without_one() -> None:
    """The message names the axis."""
    with pytest.raises(ConfigError, match="mode: adaptive needs a sensor on every axis, y has"):
        load(NO_SENSOR, ("rate_hz: 1000\n", "rate_hz: 1000\nmode: adaptive\n"))
