"""Results of the steps on rigs with known properties."""

import numpy as np
import pytest

from piezod.commission.noise import measure_noise
from piezod.commission.polarity import find_polarity
from piezod.commission.response import measure_delay
from piezod.commission.ringing import find_ringing
from piezod.commission.session_trace import SessionTrace
from piezod.commission.travel import amplifier_of, excursion, travel_of
from piezod.devices.interface import Device
from piezod.errors import DeviceError
from piezod.testing.faulty import FaultyDevice
from piezod.testing.injections import Injection, InjectionKind
from tests.commission.axes import T0_NS, session

STAGE = {"mode_hz": 700.0, "mode_damping": 0.03, "reversible_um": 12.0, "irreversible_um": 18.0}
QUIET = {"amplifier": {"gain_error": 0.004}, "sensor": {"delay_s": 1e-4}, "stage": STAGE}


def reversed_sensor(device: Device) -> Device:
    """Reverse the sign of the sensor."""
    return FaultyDevice(device, [Injection(InjectionKind.GAIN, 0, value=-1.0)])  # type: ignore[arg-type] # the rig is both


def stuck_output(device: Device) -> Device:
    """Make the amplifier acknowledge writes without following."""
    return FaultyDevice(device, [Injection(InjectionKind.STUCK_OUTPUT, 0)])  # type: ignore[arg-type] # the rig is both


def test_noise_is_that_of_the_sensor() -> None:
    """The noise of the simulated stack is between 10 and 30 nm, and all samples are valid."""
    with session(QUIET) as axis:
        noise, _ = measure_noise(axis)

    assert 0.01 < noise.rms_um < 0.03
    assert noise.valid_pct == 100.0


def test_a_sensor_without_noise_is_refused() -> None:
    """Every real measurement has noise."""
    stuck = Injection(InjectionKind.REPLACED, 0, value=1.0)
    with (
        session(wrap=lambda device: FaultyDevice(device, [stuck])) as axis,  # type: ignore[arg-type] # the rig is both
        pytest.raises(DeviceError, match="all samples of the sensor are equal"),
    ):
        measure_noise(axis)


def test_a_sensor_without_valid_samples_ends_the_step() -> None:
    """The message states the share."""
    dropped = Injection(InjectionKind.DROPPED, 0)
    with (
        session(wrap=lambda device: FaultyDevice(device, [dropped])) as axis,  # type: ignore[arg-type] # the rig is both
        pytest.raises(DeviceError, match="0 % of the sensor's samples are valid"),
    ):
        measure_noise(axis)


def test_polarity_is_found_at_a_few_volts() -> None:
    """The slope is 1/12 µm/V on the lowest part of the loop, and significantly positive."""
    with session(QUIET) as axis:
        polarity, trace = find_polarity(axis, 3.0, 0.02)

    assert polarity.step_v == 3.0
    assert max(trace.drive_v) <= 3.0
    assert 0.05 < polarity.um_per_v < 0.15
    assert polarity.uncertainty_um_per_v < 0.01


def test_a_reversed_sensor_shows() -> None:
    """The sign is negative."""
    with session(QUIET, wrap=reversed_sensor) as axis:
        polarity, _ = find_polarity(axis, 3.0, 0.02)

    assert polarity.um_per_v < -0.05


def test_a_stage_that_does_not_move_is_told_from_noise() -> None:
    """The message states the displacement and what to check."""
    still = [
        Injection(InjectionKind.REPLACED, 0, value=1.0),
        Injection(InjectionKind.NOISE, 0, value=0.02),
    ]
    with (
        session(QUIET, wrap=lambda one: FaultyDevice(one, still)) as axis,  # type: ignore[arg-type] # the rig is both
        pytest.raises(DeviceError, match=r"does not move: .* nm for \+3\.00 V"),
    ):
        find_polarity(axis, 3.0, 0.02)


def test_travel_and_gain_error_are_found() -> None:
    """30 µm are found within 3 % including creep, and the gain error of 0.4 % within a tenth."""
    with session(QUIET) as axis:
        trace = excursion(axis, 150.0)
        travel, amplifier = travel_of(trace, 0.02), amplifier_of(trace)

    assert travel.travel_um == pytest.approx(30.0, rel=0.03)
    assert 5.0 < travel.loop_pct < 25.0
    assert amplifier is not None
    assert amplifier.gain == pytest.approx(1.004, abs=4e-4)


def test_a_saturated_sensor_ends_the_travel() -> None:
    """The message states the voltage of the ramp."""
    with (
        session({"sensor": {"saturation_v": 3.5}}) as axis,
        pytest.raises(DeviceError, match=r"on the way to 150\.0 V are valid"),
    ):
        excursion(axis, 150.0)


def test_a_millisecond_of_delay_is_a_millisecond() -> None:
    """The difference between two rigs is found within 30 µs."""
    found = []
    for delay_s in (1e-4, 1.1e-3):
        with session({**QUIET, "sensor": {"delay_s": delay_s}}) as axis:
            axis.go(15.0)
            found.append(measure_delay(axis, 6.0)[0].delay_s)

    assert found[1] - found[0] == pytest.approx(1e-3, abs=3e-5)


@pytest.mark.parametrize("rate_hz", [500.0, 1000.0, 4000.0])
@pytest.mark.few(1)
def test_the_first_mode_is_found_also_beyond_half_the_rate(rate_hz: float) -> None:
    """A mode at 700 Hz is found within 2 % at rates of 500 Hz, 1 kHz and 4 kHz."""
    with session(QUIET, rate_hz=rate_hz) as axis:
        axis.go(15.0)
        axis.rest(0.5)
        ringing, _ = find_ringing(axis, 6.0)

    assert ringing.frequency_hz == pytest.approx(700.0, rel=0.02)
    assert 0.015 < ringing.damping < 0.06


def test_a_stage_that_does_not_ring_has_no_mode() -> None:
    """Noise alone gives no mode."""
    with session({**QUIET, "effects": {"mode": False}}) as axis:
        axis.go(15.0)
        axis.rest(0.5)
        ringing, _ = find_ringing(axis, 6.0)

    assert not ringing.found


def test_an_amplifier_that_stays_is_told_from_a_stage_that_does() -> None:
    """Its read-back reveals it."""
    with (
        session(QUIET, wrap=stuck_output) as axis,
        pytest.raises(DeviceError, match=r"differs by -3\.0 V"),
    ):
        find_polarity(axis, 3.0, 0.02)


DEAD_NS = T0_NS + 2_500_000_000


def dying_sensor(device: Device) -> Device:
    """Make the sensor return nothing after half a second."""
    return FaultyDevice(device, [Injection(InjectionKind.DROPPED, DEAD_NS)])  # type: ignore[arg-type] # the rig is both


def test_a_sensor_that_dies_has_no_polarity() -> None:
    """Invalid samples give no result."""
    with (
        session(QUIET, wrap=dying_sensor) as axis,
        pytest.raises(DeviceError, match="no valid samples any more"),
    ):
        find_polarity(axis, 3.0, 0.02)


def test_a_sensor_that_dies_has_no_delay() -> None:
    """A sine with too few samples has no phase."""
    with (
        session(QUIET, wrap=dying_sensor) as axis,
        pytest.raises(DeviceError, match=r"gave 0 valid samples during a sine of 2\.5 Hz"),
    ):
        axis.rest(0.6)
        measure_delay(axis, 6.0)


def test_a_sensor_that_dies_does_not_ring() -> None:
    """Without a complete record there is no mode."""
    with session(QUIET, wrap=dying_sensor) as axis:
        axis.rest(0.6)
        ringing, _ = find_ringing(axis, 6.0)

    assert not ringing.found


def test_a_sensor_that_is_blind_at_the_far_end_has_no_travel() -> None:
    """On a slow ramp few samples are lost there, but they are the relevant ones."""
    t_s = np.linspace(0.0, 100.0, 10_001)
    drive_v = np.minimum(t_s, 100.0 - t_s)
    position_um = np.where(drive_v > 49.9, np.nan, 0.2 * drive_v)
    trace = SessionTrace(t_s, drive_v, drive_v, position_um)

    with pytest.raises(DeviceError, match=r"no valid samples at 50\.0 V"):
        travel_of(trace, 0.02)
