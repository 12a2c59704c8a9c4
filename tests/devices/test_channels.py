"""The channels that combine all devices into one sensor and one amplifier."""

from collections.abc import Sequence
from math import isnan, nan

import pytest

from piezod.config.channels import (
    Calibration,
    LineCalibration,
    PolynomialCalibration,
    TableCalibration,
)
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Identity, KnowsTruth, Sample, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.devices.wiring import ChannelPair, wiring_of
from piezod.errors import DeviceError, DeviceUnavailableError


class FakeDevice:
    """Base of the fakes; it records its calls."""

    def __init__(self, axes: tuple[str, ...], *, absent: bool = False) -> None:
        self.axes, self.absent = axes, absent
        self.done: list[str] = []

    def open(self) -> Identity:
        if self.absent:
            raise DeviceUnavailableError("nothing answers")
        self.done.append("open")
        return Identity("maker", "model", "serial", "firmware")

    def capabilities(self) -> Capabilities:
        return Capabilities(
            self.axes, self.axes, read_back=True, max_rate_hz=1000.0 * len(self.axes)
        )

    def activate(self, now_ns: int) -> None:
        self.done.append(f"activate {now_ns}")

    def deactivate(self, now_ns: int) -> None:
        self.done.append(f"deactivate {now_ns}")

    def close(self) -> None:
        self.done.append("close")


class FakeSensor(FakeDevice):
    """Measures 1 µm on its first axis and 2 µm on its second."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        return [Sample(now_ns - 5, 1.0 + i, valid=True) for i in range(len(self.axes))]


class FakeAmplifier(FakeDevice):
    """Accepts every write unless a test sets it to refuse."""

    def __init__(self, axes: tuple[str, ...], *, refusing: bool = False) -> None:
        super().__init__(axes)
        self.refusing = refusing
        self.drive_v: Sequence[float] = [0.0] * len(axes)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - protocol
        if not self.refusing:
            self.drive_v = drive_v
        return not self.refusing

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - protocol
        return self.drive_v


class FakeBoth(FakeSensor, FakeAmplifier):
    """A sensor and amplifier in one."""


class FakeSimulation(FakeBoth):
    """A combined sensor and amplifier; its true displacements are 10 µm and 20 µm."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - protocol
        return [10.0 * (1 + i) for i in range(len(self.axes))]


TWO_AXES = {"x": ChannelPair("fibre", "left"), "y": ChannelPair("fibre", "right")}


def two_axes(*, refusing: bool = False) -> tuple[Channels, dict[str, FakeDevice]]:
    """Return two axes on one sensor and two amplifiers."""
    devices: dict[str, FakeDevice] = {
        "fibre": FakeSensor(("x", "y")),
        "left": FakeAmplifier(("x",)),
        "right": FakeAmplifier(("y",), refusing=refusing),
    }
    return Channels(devices, TWO_AXES), devices


def test_a_device_is_asked_for_the_channels_that_axes_name() -> None:
    """The order is that of the axes; by default a channel has the name of its axis."""
    wirings = [wiring_of(name, TWO_AXES) for name in ("fibre", "left", "right", "other")]

    assert wirings == [
        Wiring(("x", "y"), ()),
        Wiring((), ("x",)),
        Wiring((), ("y",)),
        Wiring((), ()),
    ]


def test_a_channel_may_be_called_otherwise_than_its_axis() -> None:
    """Each axis finds its own channel among those of the device."""
    axes = {
        "x": ChannelPair("rig", "rig", "AIN1", "DAC0"),
        "y": ChannelPair("rig", "rig", "AIN0", "DAC1"),
    }
    channels = Channels({"rig": FakeBoth(("first", "second"))}, axes)
    channels.write([1.0, 2.0], 0)

    assert wiring_of("rig", axes) == Wiring(("AIN1", "AIN0"), ("DAC0", "DAC1"))
    assert channels.read_back(0) == [1.0, 2.0]


def test_samples_come_in_the_order_of_the_axes_from_their_zero_on() -> None:
    """Zeroing shifts the displacement of its axis, but not the instant."""
    channels, _ = two_axes()
    channels.zero([0.25, 0.5], [0.0, 0.0])

    assert [Sample(95, 0.75, True), Sample(95, 1.5, True)] == channels.read(100)


def test_the_truth_has_a_zero_of_its_own() -> None:
    """True displacements are in the order of the axes and independent of the sensor's zero."""
    axes = {"x": ChannelPair("rig", "rig"), "y": ChannelPair("rig", "rig")}
    channels = Channels({"rig": FakeSimulation(("x", "y"))}, axes)
    channels.zero([0.25, 0.5], [1.0, 2.0])

    assert isinstance(channels, KnowsTruth)
    assert channels.true_position_um(100) == [9.0, 18.0]
    assert [sample.position_um for sample in channels.read(100)] == [0.75, 1.5]


def test_the_truth_of_an_axis_is_nan_where_its_sensor_does_not_know_it() -> None:
    """A simulated amplifier of another stage contributes no true displacement."""
    axes = {"x": ChannelPair("fibre", "rig"), "y": ChannelPair("rig", "rig")}
    devices = {"fibre": FakeSensor(("x",)), "rig": FakeSimulation(("y",))}
    x_um, y_um = Channels(devices, axes).true_position_um(100)

    assert isnan(x_um)
    assert y_um == 10.0


def test_voltages_go_to_the_amplifier_of_their_axis() -> None:
    """Each device gets and reads back the values of its own axes only."""
    channels, devices = two_axes()

    assert channels.write([3.0, 4.0], 100)
    assert devices["left"].drive_v == [3.0]  # type: ignore[attr-defined] # a FakeAmplifier
    assert channels.read_back(100) == [3.0, 4.0]


@pytest.mark.parametrize("drive_v", [(nan, 20.0, 30.0), (10.0, 20.0, nan), (nan, 20.0, nan)])
def test_a_device_without_a_voltage_for_each_of_its_axes_is_left_alone(
    drive_v: Sequence[float],
) -> None:
    """The other device is written; no device gets a part of its values."""
    first, second = FakeBoth(("x", "z")), FakeBoth(("y",))
    of = {"x": "first", "y": "second", "z": "first"}
    axes = {axis: ChannelPair(name, name) for axis, name in of.items()}
    channels = Channels({"first": first, "second": second}, axes)

    assert channels.write(drive_v, 0)
    assert (first.drive_v, second.drive_v) == ([0.0, 0.0], [20.0])


def test_a_write_that_one_device_refuses_is_refused() -> None:
    """A refusal by any device makes the write fail."""
    channels, _ = two_axes(refusing=True)

    assert not channels.write([3.0, 4.0], 100)


def test_one_device_may_play_both_roles() -> None:
    """Its two channels serve one axis each."""
    axes = {"x": ChannelPair("rig", "rig"), "y": ChannelPair("rig", "rig")}
    channels = Channels({"rig": FakeBoth(("x", "y"))}, axes)
    channels.write([1.0, 2.0], 0)

    assert channels.read_back(0) == [1.0, 2.0]
    assert [sample.position_um for sample in channels.read(0)] == [1.0, 2.0]


@pytest.mark.parametrize("role", ["sensor", "amplifier"])
def test_a_device_that_cannot_play_its_role_is_refused(role: str) -> None:
    """The message names the device and the role."""
    pair = ChannelPair("both", "plain") if role == "amplifier" else ChannelPair("plain", "both")
    with pytest.raises(DeviceError, match=f"device plain is no {role}"):
        Channels(
            {"plain": FakeDevice(("x",)), "both": FakeBoth(("x",))},
            {"x": pair},
        )


def test_the_life_cycle_reaches_every_device() -> None:
    """Each call reaches the devices in their order."""
    channels, devices = two_axes()
    identity = channels.open()
    channels.activate(1)
    channels.deactivate(2)
    channels.close()

    assert identity.maker == "maker + maker + maker"
    assert channels.capabilities() == Capabilities(
        ("x", "y"), ("x", "y"), read_back=True, max_rate_hz=1000.0
    )
    for device in devices.values():
        assert device.done == ["open", "activate 1", "deactivate 2", "close"]


def test_a_device_that_is_absent_leaves_none_open() -> None:
    """Devices opened before it are closed again."""
    fibre, absent = FakeSensor(("x",)), FakeBoth(("x",))
    absent.absent = True
    channels = Channels({"fibre": fibre, "rig": absent}, {"x": ChannelPair("fibre", "rig")})
    with pytest.raises(DeviceUnavailableError, match="nothing answers"):
        channels.open()

    assert fibre.done == ["open", "close"]


@pytest.mark.parametrize("error", [UnicodeDecodeError("ascii", b"\xff", 0, 1, "no"), SystemExit()])
def test_a_driver_that_fails_to_open_leaves_none_open(
    monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    """This holds for any exception, not only for the documented ones."""

    def wrong(_device: FakeDevice) -> Identity:
        raise error

    fibre, failing = FakeSensor(("x",)), FakeBoth(("x",))
    monkeypatch.setattr(FakeBoth, "open", wrong)
    channels = Channels({"fibre": fibre, "rig": failing}, {"x": ChannelPair("fibre", "rig")})
    with pytest.raises(type(error)):
        channels.open()

    assert fibre.done == ["open", "close"]


def failing(devices: dict[str, FakeDevice], *names: str) -> None:
    """Make the drivers of these devices raise in calls that must never raise."""

    def fail(name: str) -> None:
        raise OSError(f"{name} failed")

    for name in names:
        devices[name].deactivate = lambda _now_ns, name=name: fail(name)  # type: ignore[method-assign, misc]
        devices[name].close = lambda name=name: fail(name)  # type: ignore[method-assign, misc]


def test_one_driver_that_fails_leaves_no_other_amplifier_as_it_is() -> None:
    """All devices are deactivated and closed; the first error is raised at the end."""
    channels, devices = two_axes()
    failing(devices, "fibre", "left")

    with pytest.raises(OSError, match="fibre failed"):
        channels.deactivate(2)
    with pytest.raises(OSError, match="fibre failed"):
        channels.close()
    assert devices["right"].done == ["deactivate 2", "close"]


def test_error_of_opening_is_raised_even_if_another_device_cannot_be_closed() -> None:
    """The error of opening comes first, because the user can act on it."""
    channels, devices = two_axes()
    failing(devices, "fibre")
    devices["right"].absent = True

    with pytest.raises(DeviceUnavailableError, match="nothing answers"):
        channels.open()
    assert devices["left"].done == ["open", "close"]


class FakeTeller(FakeAmplifier):
    """Reports an overload of its first axis."""

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - protocol
        return [frozenset({DeviceFlag.OVERLOAD})] + [NO_FLAGS] * (len(self.axes) - 1)


class FakeDimSensor(FakeSensor):
    """Reports too little light."""

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - protocol
        return [frozenset({DeviceFlag.LOW_LIGHT})] * len(self.axes)


def test_the_status_is_that_of_the_sensor_of_each_axis_then_of_its_amplifier() -> None:
    """A device without status contributes nothing; a shared device reports for each axis."""
    axes = {"x": ChannelPair("dim", "teller"), "y": ChannelPair("silent", "teller")}
    devices = {
        "dim": FakeDimSensor(("x",)),
        "silent": FakeSensor(("y",)),
        "teller": FakeTeller(("x", "y")),
    }

    told = Channels(devices, axes).status(0)
    assert told == [{DeviceFlag.LOW_LIGHT}, NO_FLAGS, {DeviceFlag.OVERLOAD}, NO_FLAGS]


def test_channels_of_devices_without_status_have_no_flags() -> None:
    """Every axis has empty flags."""
    axes = {"x": ChannelPair("sensor", "amplifier")}
    devices = {"sensor": FakeSensor(("x",)), "amplifier": FakeAmplifier(("x",))}

    assert Channels(devices, axes).status(0) == [NO_FLAGS, NO_FLAGS]


def ranged(low: float, high: float, to_v: Calibration) -> Channels:
    """Return an open axis, x, whose amplifier has this range."""

    class Ranged(FakeAmplifier):
        def capabilities(self) -> Capabilities:
            return super().capabilities()._replace(ranges=((low, high),))

    axes = {"x": ChannelPair("fibre", "short", to_v=to_v)}
    channels = Channels({"fibre": FakeSensor(("x",)), "short": Ranged(("x",))}, axes)
    channels.open()
    return channels


@pytest.mark.parametrize(
    ("limits_v", "beyond"), [((-20.0, 120.0), False), ((0.0, 120.1), True), ((-20.1, 0.0), True)]
)
def test_limits_that_an_amplifier_cannot_reach_are_reported(
    limits_v: tuple[float, float], *, beyond: bool
) -> None:
    """The message names the axis and the range of its amplifier."""
    text = ranged(-20.0, 120.0, LineCalibration()).beyond_reach([limits_v])

    assert bool(text) is beyond
    assert not beyond or "axis x" in text
    assert not beyond or "gives -20 to 120 V" in text


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("whole", [True, False])
def test_a_calibration_may_hold_for_less_than_the_device_can_give(
    sign: float, *, whole: bool
) -> None:
    """The range of the calibration is reachable; limits beyond it are not."""
    high_v = 150.0 if whole else 120.0
    for curve in (
        TableCalibration(values=(0.0, 10.0), physical=(0.0, 150.0 * sign)),
        PolynomialCalibration(coefficients=(0.0, 15.0 * sign), values=(0.0, 10.0)),
    ):
        channels = ranged(-10.0, 10.0 if whole else 8.0, curve)
        limits_v = sorted((0.0, high_v * sign)), sorted((0.0, 151.0 * sign))

        assert channels.beyond_reach([(limits_v[0][0], limits_v[0][1])]) == ""
        assert channels.beyond_reach([(limits_v[1][0], limits_v[1][1])])
        assert channels.write([high_v * sign], 0)


def test_the_end_of_what_an_amplifier_can_give_can_be_written() -> None:
    """At the end of the range, rounding gives no value that the device would refuse."""
    channels = ranged(0.0, 10.0, LineCalibration(gain=1.5, offset=12.1))
    channels.write([27.1], 0)

    assert channels.beyond_reach([(20.0, 27.1)]) == ""
    amplifier = channels.devices["short"]
    assert isinstance(amplifier, FakeAmplifier)
    assert amplifier.drive_v == [10.0]
