"""The simulated rig as a device; the driver contract has the checks for all drivers."""

from collections.abc import Callable, Iterable, Sequence
from math import inf, nan
from typing import Any

import numpy as np
import pytest

from piezod.devices.interface import Amplifier, KnowsTruth, Sensor, Wiring
from piezod.errors import DeviceError
from piezod.plant.effects import EFFECTS
from piezod_drivers.simulated.driver import PLUGIN, SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

MS = 1_000_000
T0_NS = 5_000_000_000


def active(axes: tuple[str, ...] = ("x",), seed: int = 1, **options: Any) -> SimulatedRig:
    """Open and activate a rig."""
    rig = PLUGIN.create(SimulatedOptions.model_validate(options), Wiring.both(axes), seed)
    assert isinstance(rig, SimulatedRig)
    rig.open()
    rig.activate(T0_NS)
    return rig


def drive(rig: SimulatedRig, drive_v: Iterable[Sequence[float]]) -> Any:
    """Write one row of voltages per millisecond and return the positions after each, in µm."""
    positions_um = []
    for k, row in enumerate(drive_v):
        assert rig.write(row, T0_NS + k * MS)
        positions_um.append([sample.position_um for sample in rig.read(T0_NS + (k + 1) * MS)])
    return np.array(positions_um)


def only(*effects: str) -> dict[str, bool]:
    """Return the switches that leave only some effects on."""
    return {effect: effect in effects for effect in EFFECTS}


def residual_pct(drawn: Any) -> float:
    """Return the greatest error of the readings over the travel, in % of travel."""
    rig = active(**drawn)
    drive_v = np.linspace(0, 150, 601)
    measured_um = drive(rig, [[command_v] for command_v in drive_v])[:, 0]
    travel_um = drawn["stage"]["reversible_um"] + drawn["stage"]["irreversible_um"]
    return float(100 * np.max(np.abs(measured_um / travel_um - drive_v / 150)))


def test_rig_is_sensor_and_amplifier_and_knows_the_truth() -> None:
    """One device is sensor and amplifier, and knows the true displacement."""
    rig = active()

    assert isinstance(rig, Sensor)
    assert isinstance(rig, Amplifier)
    assert isinstance(rig, KnowsTruth)


def truth_and_readings(rig: SimulatedRig, drive_v: Iterable[float]) -> tuple[Any, Any]:
    """Write a voltage per millisecond; return the true and the measured displacement, in µm."""
    true_um, measured_um = [], []
    for k, command_v in enumerate(drive_v):
        assert rig.write([command_v], T0_NS + k * MS)
        measured_um.append(rig.read(T0_NS + (k + 1) * MS)[0].position_um)
        true_um.append(rig.true_position_um(T0_NS + (k + 1) * MS)[0])
    return np.array(true_um), np.array(measured_um)


def test_truth_is_what_a_perfect_sensor_would_measure() -> None:
    """A perfect sensor measures the true displacement, counted from rest."""
    perfect = only("hysteresis", "asymmetry", "creep", "mode")
    rig = active(effects=perfect, calibration={"kind": "commissioned", "residual_pct": 0.0})
    true_um, measured_um = truth_and_readings(rig, 70 - 70 * np.cos(np.arange(500) / 40))

    assert np.ptp(true_um) > 20.0
    assert abs(true_um[0]) < 0.01
    assert true_um == pytest.approx(measured_um, abs=1e-3)


def test_truth_has_none_of_the_sensors_faults() -> None:
    """The true displacement does not depend on the sensor's calibration, to the bit."""
    drive_v = 70 - 70 * np.cos(np.arange(500) / 40)
    calibrated, straight = (
        truth_and_readings(active(calibration=kind), drive_v)
        for kind in ({"kind": "commissioned"}, {"kind": "line"})
    )

    assert np.array_equal(calibrated[0], straight[0])
    assert np.max(np.abs(calibrated[1] - straight[1])) > 0.1


def test_identity_names_variant_and_seed() -> None:
    """The identity shows that the rig is simulated, with variant and seed."""
    identity = SimulatedRig(SimulatedOptions(variant="afm"), Wiring.both("x"), 42).open()

    assert (identity.model, identity.serial) == ("simulated afm", "seed 42")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("variant", "low_pct", "high_pct"),
    [("stack", 0.049, 0.051), ("stack-uncalibrated", 0.89, 1.11)],
)
def test_calibration_leaves_what_the_variant_promises(
    variant: str, low_pct: float, high_pct: float, seed: int
) -> None:
    """With a linear, noiseless stage 0.05 % of range remain, 1 % (± a tenth) uncalibrated."""
    stage = {"reversible_um": 20.0, "irreversible_um": 10.0}
    effects = only("nonlinearity")
    left_pct = residual_pct({"variant": variant, "stage": stage, "effects": effects, "seed": seed})

    assert low_pct <= left_pct <= high_pct


def test_residual_of_the_calibration_can_be_chosen() -> None:
    """A better calibration leaves a smaller error."""
    stage = {"reversible_um": 20.0, "irreversible_um": 10.0}
    calibration = {"kind": "commissioned", "residual_pct": 0.2}
    left_pct = residual_pct(
        {"stage": stage, "effects": only("nonlinearity"), "calibration": calibration}
    )

    assert left_pct == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize("turned", [False, True])
def test_table_of_the_configuration_is_the_curve(turned: bool) -> None:
    """A configured table is interpolated linearly, also beyond its ends."""
    points = [(1.0, 0.0), (2.0, 10.0), (4.0, 40.0)]
    sensor_v, position_um = zip(*(points[::-1] if turned else points), strict=True)
    rig = active(
        stage={"reversible_um": 30.0, "irreversible_um": 0.0},
        sensor={"slope_v_per_um": 0.1, "light_level": 1.0},
        effects=only(),
        calibration={"kind": "table", "sensor_v": sensor_v, "position_um": position_um},
    )

    # 10 µm of gap and 0, 15 and 30 µm of travel are 1, 2.5 and 4 V; 36 µm are 4.6 V.
    assert drive(rig, [[0], [75], [150], [180]])[:, 0] == pytest.approx([0, 17.5, 40, 49])


def test_far_side_can_be_calibrated_too() -> None:
    """A probe behind the maximum sees the light decrease, and can be calibrated."""
    stage = {"reversible_um": 20.0, "irreversible_um": 10.0}
    drawn = {"stage": stage, "effects": only("nonlinearity"), "sensor": {"setback_um": 150.0}}

    assert residual_pct(drawn) == pytest.approx(0.05, abs=0.002)


def test_sensor_whose_light_peaks_within_the_travel_cannot_be_calibrated() -> None:
    """If one voltage means two displacements, opening fails with the reason."""
    rig = SimulatedRig(
        SimulatedOptions.model_validate({"sensor": {"setback_um": 85.0}}), Wiring.both("x"), 1
    )

    with pytest.raises(DeviceError, match="not monotonic over the travel"):
        rig.open()


def test_saturated_sample_is_invalid() -> None:
    """With too much light the sample at full travel is invalid, and the one at rest is valid."""
    rig = active(sensor={"light_level": 5.0})
    at_rest = rig.read(T0_NS)[0]
    for k in range(20):
        rig.write([150.0], T0_NS + k * MS)
    at_full_travel = rig.read(T0_NS + 20 * MS)[0]

    assert (at_rest.valid, at_full_travel.valid) == (True, False)


@pytest.mark.parametrize("bad_v", [nan, inf, -inf, 160.001, -10.001, 1e9])
def test_bad_voltage_is_refused_and_the_output_stays(bad_v: float) -> None:
    """A voltage that is not finite or beyond -10 to 160 V changes no axis."""
    rig = active(("x", "y"), effects=only("voltage_limits"))
    assert rig.write([50.0, 60.0], T0_NS)

    assert rig.write([70.0, bad_v], T0_NS + MS) is False
    assert list(rig.read_back(T0_NS + 2 * MS)) == pytest.approx([50.0, 60.0])


@pytest.mark.parametrize("edge_v", [160.0, -10.0])
def test_voltage_at_the_limit_is_taken(edge_v: float) -> None:
    """The limits themselves are allowed."""
    assert active().write([edge_v], T0_NS) is True


def test_without_voltage_limits_the_converter_is_the_limit() -> None:
    """A converter of ±10 V and a gain of 20 allow ±200 V."""
    rig = active(effects={"voltage_limits": False})

    assert [rig.write([v], T0_NS) for v in (200.0, 200.1, -200.0)] == [True, False, True]


def test_write_of_the_wrong_length_is_refused() -> None:
    """One value too many or too few is refused."""
    rig = active(("x", "y"))

    assert [rig.write(row, T0_NS) for row in ([1.0], [1.0, 2.0, 3.0], [1.0, 2.0])] == [
        False,
        False,
        True,
    ]


def test_deactivation_lets_the_output_fall_as_fast_as_it_can() -> None:
    """From 150 V the output is at half after 2.3 ms and at 0 V after 6 ms."""
    rig = active(amplifier={"slew_v_per_s": 1e5, "current_limit_a": 0.1, "capacitance_uf": 3.0})
    rig.write([150.0], T0_NS)
    rig.deactivate(T0_NS + 20 * MS)
    before, half_way, after = (
        rig.read_back(T0_NS + 20 * MS + delay_ns)[0] for delay_ns in (0, 2_300_000, 6_000_000)
    )

    assert before == pytest.approx(150.3, abs=0.1)
    assert half_way == pytest.approx(75, abs=2)
    assert after == pytest.approx(0, abs=0.01)


def test_each_axis_is_a_specimen_of_its_own() -> None:
    """Two axes of one rig differ in gain, and one does not move the other."""
    only_first, only_second = (
        drive(active(("x", "y"), effects=only("hysteresis")), [row] * 3)[-1]
        for row in ([100.0, 0.0], [0.0, 100.0])
    )

    assert only_first[1] == pytest.approx(0, abs=0.02)
    assert only_second[0] == pytest.approx(0, abs=0.02)
    assert abs(only_first[0] - only_second[1]) > 0.1


def test_first_axis_does_not_depend_on_how_many_there_are() -> None:
    """A further axis does not change the others."""
    one = drive(active(("x",)), [[50.0]] * 5)
    two = drive(active(("x", "y")), [[50.0, 0.0]] * 5)

    assert list(one[:, 0]) == list(two[:, 0])


def test_same_seed_gives_the_same_record() -> None:
    """Rigs with the same seed agree to the bit, also after opening again."""
    rows = [[float(v)] for v in range(0, 150, 3)]
    rig = active(seed=3)
    first, same, other = drive(rig, rows), drive(active(seed=3), rows), drive(active(seed=4), rows)
    rig.close()
    rig.open()
    rig.activate(T0_NS)

    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)
    assert np.array_equal(first, drive(rig, rows))


def test_order_of_read_and_write_at_one_instant_does_not_matter() -> None:
    """A voltage does not affect the sample of the instant at which it is written."""
    reading_first, writing_first = active(), active()
    one = reading_first.read(T0_NS + MS)
    reading_first.write([100.0], T0_NS + MS)
    writing_first.write([100.0], T0_NS + MS)
    other = writing_first.read(T0_NS + MS)

    assert list(one) == list(other)
    assert list(reading_first.read(T0_NS + 2 * MS)) == list(writing_first.read(T0_NS + 2 * MS))


@pytest.mark.parametrize(
    "call",
    [
        lambda rig: rig.read(T0_NS + MS),
        lambda rig: rig.read_back(T0_NS + MS),
        lambda rig: rig.true_position_um(T0_NS + MS),
        lambda rig: rig.write([1.0], T0_NS + MS),
    ],
    ids=["read", "read_back", "true_position_um", "write"],
)
def test_time_that_goes_back_is_an_error(call: Callable[[SimulatedRig], Any]) -> None:
    """An instant before the last one raises `DeviceError`."""
    rig = active()
    rig.read(T0_NS + 2 * MS)

    with pytest.raises(DeviceError, match="time went back"):
        call(rig)


def test_deactivation_makes_safe_even_if_its_instant_is_wrong() -> None:
    """A past instant does not keep the output from going to rest."""
    rig = active()
    rig.write([100.0], T0_NS + 5 * MS)
    rig.deactivate(T0_NS)

    assert rig.read_back(T0_NS + 20 * MS)[0] == pytest.approx(0, abs=0.01)


def test_rig_is_at_rest_with_nothing_to_remember_whenever_it_is_opened() -> None:
    """A rig opens at rest, with a relaxed hysteresis memory."""
    rig = SimulatedRig(SimulatedOptions(), Wiring.both("x"), 1)
    rig.open()

    assert rig.capabilities().opens_relaxed
