"""Channels of devices with values other than µm and V."""

from collections.abc import Mapping, Sequence
from math import isnan, nan

import pytest

from piezod.config.channels import InputConfig, LightConfig, LineCalibration, TableCalibration
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Identity, Sample, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag
from piezod.devices.wiring import ChannelPair, wiring_of

LINE = LineCalibration(gain=4.0, offset=1.0)
LIGHT = LightConfig(channel="lamp", nominal=2.0, least=1.0)
TENFOLD = TableCalibration(values=(0.0, 10.0), physical=(0.0, 150.0))


class Converter:
    """An ADC and DAC whose readings a test sets.

    Attributes:
        reads: Reading of each input, by its name; NaN for an invalid one.
        values: Values of the outputs.
    """

    def __init__(self, reads: Mapping[str, float], wiring: Wiring) -> None:
        self.reads, self._wiring = dict(reads), wiring
        self.values: Sequence[float] = [0.0] * len(wiring.outputs)

    def open(self) -> Identity:
        return Identity("maker", "converter", "1", "1")

    def capabilities(self) -> Capabilities:
        return Capabilities(*self._wiring, read_back=True, max_rate_hz=1000.0)

    def activate(self, now_ns: int) -> None:
        """Do nothing."""

    def deactivate(self, now_ns: int) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        read = (self.reads[name] for name in self._wiring.inputs)
        return [Sample(now_ns, value, not isnan(value)) for value in read]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - protocol
        if any(isnan(value) for value in drive_v):
            return False
        self.values = list(drive_v)
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - protocol
        return self.values


def converted(pair: ChannelPair, **reads: float) -> tuple[Channels, Converter]:
    """Return one axis, x, on device `daq`."""
    axes = {"x": pair}
    device = Converter(reads, wiring_of("daq", axes))
    return Channels({"daq": device}, axes), device


def test_an_input_is_made_micrometres_and_counts_from_its_zero() -> None:
    """The calibration is applied first, then the zero of the sensor."""
    channels, _ = converted(ChannelPair("daq", "daq", to_um=LINE), x=2.5)
    channels.zero([3.0], [0.0])

    assert channels.read(7) == [Sample(7, 8.0, True)]


def test_an_output_is_given_what_makes_the_voltage() -> None:
    """The output gets the calibrated value, and the read-back is in V again."""
    channels, device = converted(ChannelPair("daq", "daq", to_v=TENFOLD), x=0.0)

    assert channels.write([75.0], 0)
    assert device.values == [5.0]
    assert channels.read_back(0) == [75.0]


def test_a_voltage_that_the_output_cannot_give_is_refused() -> None:
    """The device keeps its value; a read-back beyond the table is still reported."""
    channels, device = converted(ChannelPair("daq", "daq", to_v=TENFOLD), x=0.0)
    channels.write([75.0], 0)

    assert not channels.write([150.1], 0)
    assert device.values == [5.0]
    device.values = [-0.1]
    assert channels.read_back(0) == pytest.approx([-1.5])


def test_one_output_may_be_calibrated_and_another_not() -> None:
    """One write sets a calibrated and an uncalibrated output."""
    axes = {"x": ChannelPair("daq", "daq", to_v=TENFOLD), "y": ChannelPair("daq", "daq")}
    device = Converter({"x": 0.0, "y": 0.0}, wiring_of("daq", axes))
    channels = Channels({"daq": device}, axes)

    assert channels.write([75.0, 75.0], 0)
    assert device.values == [5.0, 75.0]
    assert channels.read_back(0) == [75.0, 75.0]


def test_a_sensor_is_divided_by_its_light() -> None:
    """With half the light and half the reading, the displacement is the same."""
    pair = ChannelPair("daq", "daq", to_um=LINE, light=LIGHT)
    channels, device = converted(pair, x=2.5, lamp=2.0)

    assert channels.read(7) == [Sample(7, 11.0, True)]
    device.reads.update(x=1.25, lamp=1.0)
    assert channels.read(8) == [Sample(8, 11.0, True)]
    assert channels.status(8) == [NO_FLAGS, NO_FLAGS]


def test_light_may_only_be_watched() -> None:
    """If the device divides by the light itself, only the limit is checked."""
    light = LIGHT.model_copy(update={"divides": False})
    channels, _ = converted(ChannelPair("daq", "daq", to_um=LINE, light=light), x=2.5, lamp=1.5)

    assert channels.read(7) == [Sample(7, 11.0, True)]


@pytest.mark.parametrize(("level", "flags"), [(0.99, {DeviceFlag.LOW_LIGHT}), (nan, NO_FLAGS)])
def test_without_light_a_sample_is_not_valid(level: float, flags: set[DeviceFlag]) -> None:
    """Too little light sets the flag; a missing light value only makes the sample invalid."""
    pair = ChannelPair("daq", "daq", to_um=LINE, light=LIGHT)
    channels, device = converted(pair, x=2.5, lamp=level)

    assert [sample.valid for sample in channels.read(7)] == [False]
    assert channels.status(7) == [flags, NO_FLAGS]
    device.reads["lamp"] = 2.0
    assert [sample.valid for sample in channels.read(8)] == [True]
    assert channels.status(8) == [NO_FLAGS, NO_FLAGS]


def test_no_light_at_all_is_too_little_whatever_is_enough() -> None:
    """A light of zero is too low, even if the limit is zero."""
    light = LIGHT.model_copy(update={"least": 0.0})
    channels, _ = converted(ChannelPair("daq", "daq", light=light), x=2.5, lamp=0.0)

    assert [sample.valid for sample in channels.read(7)] == [False]
    assert channels.status(7)[0] == {DeviceFlag.LOW_LIGHT}


def test_beyond_its_table_a_sample_is_not_valid() -> None:
    """A reading beyond the table gives an invalid sample."""
    channels, device = converted(ChannelPair("daq", "daq", to_um=TENFOLD), x=10.1)

    assert [sample.valid for sample in channels.read(7)] == [False]
    device.reads["x"] = 10.0
    assert channels.read(7) == [Sample(7, 150.0, True)]


def test_a_command_is_an_input_like_any_other() -> None:
    """It is read together with the sensor, and has no zero."""
    command = InputConfig(device="daq", channel="knob", calibration=LINE)
    channels, device = converted(ChannelPair("daq", "daq", command=command), x=0.0, knob=2.0)
    channels.zero([3.0], [0.0])

    assert [sample.valid for sample in channels.commands()] == [False]
    channels.read(7)
    assert channels.commands() == [Sample(7, 9.0, True)]
    device.reads["knob"] = nan
    channels.read(8)
    assert [sample.valid for sample in channels.commands()] == [False]


def test_a_device_may_do_nothing_but_command() -> None:
    """A device may have only a command input; an axis without a command has none."""
    command = InputConfig(device="knob")
    axes = {"x": ChannelPair("daq", "daq"), "y": ChannelPair("daq", "daq", command=command)}
    devices = {
        "daq": Converter({"x": 1.0, "y": 2.0}, wiring_of("daq", axes)),
        "knob": Converter({"y": 5.0}, wiring_of("knob", axes)),
    }
    channels = Channels(devices, axes)

    assert wiring_of("knob", axes) == Wiring(("y",), ())
    assert [sample.position_um for sample in channels.read(7)] == [1.0, 2.0]
    assert [sample.valid for sample in channels.commands()] == [False, True]
    assert channels.commands()[1] == Sample(7, 5.0, True)


def test_two_axes_may_share_their_light() -> None:
    """Their common light is read once."""
    axes = {name: ChannelPair("daq", "daq", light=LIGHT) for name in ("x", "y")}

    assert wiring_of("daq", axes) == Wiring(("x", "lamp", "y"), ("x", "y"))
