"""A fast waveform is learned over a slow bus."""

import pytest

from piezod.config.channels import LineCalibration
from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.interface import Wiring
from piezod.devices.wiring import ChannelPair
from piezod.dynamics.model import ResponseModel
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import learn
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import KnownAxis, PlaySettings
from piezod.units import NS_PER_S
from piezod_drivers.modbus import emulator as labjack_emulator
from piezod_drivers.modbus.driver import make_device as make_modbus_device
from piezod_drivers.modbus.emulation.labjack import LabJackServer
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.serial_line.pi_gcs2.driver import make_device as make_pi_device
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from tests.drivers.bus.learned_axis import Connect, Connected, LearnedAxis
from tests.drivers.modbus.emulated import transactions_over
from tests.drivers.modbus.stream_line import StreamLine
from tests.drivers.serial_line.pi_gcs2_bench import OPTIONS as PI_OPTIONS
from tests.drivers.serial_line.scripted_line import EmulatedLine, TestTime
from tests.experiment.play.rig_axis import (
    INTERVAL_NS,
    LIMITS,
    RESPONSE,
    SENSOR_DELAY_S,
    known_response,
    model,
    sine,
)

SETTINGS = PlaySettings(passes=4, settle_s=0.3, record_s=0.1)
LONG = PlaySettings(passes=6, settle_s=3.0, record_s=1.0)
SLOW = PlaySettings(passes=6, settle_s=3.0, record_s=3.0)
"""At 10 Hz an average has fewer periods, so that its noise would be learned."""
ONE_POINT_S = 50e-6


def labjack(rig: SharedRig, time: TestTime) -> Connected:
    """Connect a T7 whose amplifier multiplies by 30, with a sensor of 5 µm/V."""
    create = labjack_emulator.LABJACK_T7.create
    assert create is not None
    server = create(rig, "")
    assert isinstance(server, LabJackServer)
    options = ModbusOptions.model_validate({"profile": "labjack-t7", "host": "t7"})
    device = make_modbus_device(
        options,
        Wiring(("AIN0",), ("DAC0",)),
        transactions_over(EmulatedLine(server, time), options),
        StreamLine(server, time),
    )
    scales = LineCalibration(gain=5.0), LineCalibration(gain=30.0)
    return _active(device, server, ChannelPair("device", "device", "AIN0", "DAC0", *scales), time)


def pi(rig: SharedRig, time: TestTime) -> Connected:
    """Connect a PI controller that is known to hold the last value of a wave."""
    emulator = Gcs2Emulator(rig, "")
    options = PI_OPTIONS.model_copy(update={"wave_end": "holds"})
    device = make_pi_device(EmulatedLine(emulator, time), options, Wiring.both(("1",)))
    return _active(device, emulator, ChannelPair("device", "device", "1", "1"), time)


def _active(
    device: object, emulator: LabJackServer | Gcs2Emulator, pair: ChannelPair, time: TestTime
) -> Connected:
    assert isinstance(device, PlayingBusDevice)
    device.open()
    device.activate(time.t_ns)
    return Connected(device, emulator, pair)


def known_axis(interval_ns: int, lag_s: float) -> KnownAxis:
    """Return what is known of the axis for tables of an interval.

    Args:
        interval_ns: Time between two points, in ns; the response of the rig has that of 50 µs.
        lag_s: Lag of the outputs behind the record, in s.
    """
    delay_s = RESPONSE.delay_s + lag_s + 0.5 * (interval_ns - INTERVAL_NS) / NS_PER_S
    response = known_response(ResponseModel(delay_s, RESPONSE.resonances))
    makes = TableMaker(model(), interval_ns, LIMITS[:2], LIMITS.slew_v_per_s)
    return KnownAxis(makes, model().creep, response, SENSOR_DELAY_S)


DEVICES = pytest.mark.parametrize(
    # An output of a LabJack follows the sample of its scan, and acts in the next step of the rig.
    ("connect", "lag_s"),
    [(labjack, ONE_POINT_S), (pi, 0.0)],
    ids=["labjack-t7", "pi-gcs2"],
)


WAVES = pytest.mark.parametrize(
    ("kind", "frequency_hz"),
    [("sine", 10.0), ("sine", 50.0), ("sine", 100.0), ("sine", 200.0), ("triangle", 100.0)],
)


def wave_of(kind: str, frequency_hz: float) -> WaveConfig:
    """Return a waveform from 4 to 24 µm."""
    command_um = {"kind": kind, "low": 4.0, "high": 24.0, "frequency_hz": frequency_hz}
    data = {"name": "wave", "command_um": command_um}
    return WaveConfig.model_validate(data, context=Context())


def interval_of(frequency_hz: float, small: bool) -> int:
    """Return the interval of a table in ns, for a device with a small memory or another one."""
    return 2 * INTERVAL_NS if small and frequency_hz <= 10.0 else INTERVAL_NS


@DEVICES
def test_sine_of_200_hz_is_learned(connect: Connect, lag_s: float) -> None:
    """The true error, which the device does not report, falls to a fraction."""
    known = known_axis(INTERVAL_NS, lag_s)
    learned = learn(LearnedAxis(connect), known.task(sine(), SETTINGS), lambda _: None)
    assert learned.best.true.rms_pct < 0.25 * learned.reports[0].true.rms_pct
    assert learned.best.true.max_pct < 0.3


@pytest.mark.stress
@WAVES
@DEVICES
def test_waveforms_are_learned_to_a_fifth_of_a_per_cent(
    connect: Connect, lag_s: float, kind: str, frequency_hz: float
) -> None:
    """The true error is at most 0.2 % of the swing, at worst, after six passes.

    A LabJack has memory for a slow waveform only with a longer interval.
    """
    interval_ns = interval_of(frequency_hz, connect is labjack)
    command = command_of(wave_of(kind, frequency_hz), interval_ns)
    known = known_axis(interval_ns, lag_s * interval_ns / INTERVAL_NS)
    axis = LearnedAxis(connect, interval_ns)
    settings = LONG if frequency_hz > 10.0 else SLOW
    learned = learn(axis, known.task(command, settings), lambda _: None)
    assert learned.best.true.max_pct <= 0.2, learned.stopped
