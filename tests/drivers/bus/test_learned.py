"""A fast waveform is learned over a slow bus."""

import numpy as np
import pytest

from piezod.config.channels import LineCalibration
from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator
from piezod.devices.interface import Wiring
from piezod.devices.wiring import ChannelPair
from piezod.dynamics.model import ResponseModel
from piezod.experiment.play.command import PeriodicCommand, command_of
from piezod.experiment.play.learn import learn
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import KnownAxis, PlaySettings
from piezod.units import NS_PER_S
from piezod_drivers.modbus import emulator as labjack_emulator
from piezod_drivers.modbus.driver import make_device as make_modbus_device
from piezod_drivers.modbus.emulation.labjack import LabJackServer
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.serial_line.npoint_lc400.driver import make_device as make_lc400_device
from piezod_drivers.serial_line.npoint_lc400.emulation.wavetables import MID_UM, MID_V, V_PER_PCT
from piezod_drivers.serial_line.npoint_lc400.emulator import Lc400
from piezod_drivers.serial_line.npoint_lc400.options import Lc400Options
from piezod_drivers.serial_line.pi_gcs2.driver import make_device as make_pi_device
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from piezod_drivers.serial_line.psj.driver import make_device as make_psj_device
from piezod_drivers.serial_line.psj.emulator import PsjEmulator
from piezod_drivers.serial_line.psj.options import PsjOptions
from piezod_drivers.serial_line.psj.player import HOLD_NS
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

SETTINGS = PlaySettings(passes=4, settle_s=0.1, record_s=0.05)
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


def lc400(rig: SharedRig, time: TestTime) -> Connected:
    """Connect an LC.400, whose commands of -50 and 50 % drive 0 and 150 V."""
    emulator = Lc400(rig, "")
    line = EmulatedLine(emulator, time)
    device = make_lc400_device(line, Lc400Options(port="p"), Wiring.both(("1",)))
    to_v = LineCalibration(gain=V_PER_PCT, offset=MID_V)
    pair = ChannelPair("device", "device", "1", "1", LineCalibration(offset=MID_UM), to_v)
    return _active(device, emulator, pair, time)


def nv200(rig: SharedRig, time: TestTime) -> Connected:
    """Connect an NV200/D that is known to hold the last value of a waveform."""
    emulator = PsjEmulator("nv200", rig, "")
    options = PsjOptions(profile="nv200", port="p", range_v=(0.0, 150.0), wave_end="holds")
    device = make_psj_device(EmulatedLine(emulator, time), options, Wiring.both(("ch0",)))
    pair = ChannelPair("device", "device", "ch0", "ch0")
    return _active(device, emulator, pair, time)._replace(held_ns=HOLD_NS)


def _active(device: object, emulator: Emulator, pair: ChannelPair, time: TestTime) -> Connected:
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
    makes = TableMaker(
        model(), interval_ns, (LIMITS.drive_min_v, LIMITS.drive_max_v), LIMITS.slew_v_per_s
    )
    return KnownAxis(makes, model().creep, response, SENSOR_DELAY_S)


# An output of a LabJack follows the sample of its scan, and acts in the next step of the rig.
LABJACK = pytest.param(labjack, ONE_POINT_S, id="labjack-t7")
PI = pytest.param(pi, 0.0, id="pi-gcs2", marks=pytest.mark.stress)
DEVICES = pytest.mark.parametrize(("connect", "lag_s"), [LABJACK, PI])


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


@pytest.mark.parametrize(
    ("connect", "interval_us", "n_points", "sub_step_us"),
    [(lc400, 240, 80, 20), (nv200, 500, 100, 50)],
    ids=["lc400", "psj-nv200"],
)
@pytest.mark.few(1)
def test_slower_sine_is_learned(
    connect: Connect, interval_us: int, n_points: int, sub_step_us: int
) -> None:
    """Devices with a small memory learn a sine of 52 and of 20 Hz, with fewer points."""
    interval_ns = interval_us * 1000
    turns = np.arange(n_points) / n_points
    values_um = 4.0 + 20.0 * (0.5 - 0.5 * np.cos(2 * np.pi * turns))
    command = PeriodicCommand("sine", values_um, interval_ns)
    limits_v = LIMITS.drive_min_v, LIMITS.drive_max_v
    maker = TableMaker(model(), interval_ns, limits_v, LIMITS.slew_v_per_s)
    known = KnownAxis(maker, model().creep, known_response(), SENSOR_DELAY_S)
    axis = LearnedAxis(connect, interval_ns, sub_step_us)
    learned = learn(axis, known.task(command, SETTINGS), lambda _: None)
    assert learned.best.true.rms_pct < 0.4 * learned.reports[0].true.rms_pct
    assert learned.best.true.max_pct < 0.5


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
