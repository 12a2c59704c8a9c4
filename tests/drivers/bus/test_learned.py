"""A fast waveform is learned over a slow bus."""

import numpy as np
import pytest

from piezod.config.channels import LineCalibration
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator
from piezod.devices.interface import Wiring
from piezod.devices.wiring import ChannelPair
from piezod.dynamics.model import ResponseModel
from piezod.experiment.play.command import PeriodicCommand
from piezod.experiment.play.learn import learn
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import KnownAxis, PlaySettings
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
    LIMITS,
    RESPONSE,
    SENSOR_DELAY_S,
    known_response,
    maker,
    model,
    sine,
)

SETTINGS = PlaySettings(passes=4, settle_s=0.3, record_s=0.1)
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


@pytest.mark.parametrize(
    ("connect", "lag_s"), [(labjack, ONE_POINT_S), (pi, 0.0)], ids=["labjack-t7", "pi-gcs2"]
)
def test_sine_of_200_hz_is_learned(connect: Connect, lag_s: float) -> None:
    """The true error, which the device does not report, falls to a fraction."""
    # An output of a LabJack follows the sample of its scan, and acts in the next step of the rig.
    response = known_response(ResponseModel(RESPONSE.delay_s + lag_s, RESPONSE.resonances))
    known = KnownAxis(maker(), model().creep, response, SENSOR_DELAY_S)
    learned = learn(LearnedAxis(connect), known.task(sine(), SETTINGS), lambda _: None)
    assert learned.best.true.rms_pct < 0.4 * learned.reports[0].true.rms_pct
    assert learned.best.true.max_pct < 0.3


@pytest.mark.parametrize(
    ("connect", "interval_us", "n_points", "sub_step_us"),
    [(lc400, 240, 80, 20), (nv200, 500, 100, 50)],
    ids=["lc400", "psj-nv200"],
)
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
