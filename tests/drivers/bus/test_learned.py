"""A fast waveform is learned over a slow bus."""

import pytest

from piezod.config.channels import LineCalibration
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.interface import Wiring
from piezod.devices.wiring import ChannelPair
from piezod.dynamics.model import ResponseModel
from piezod.experiment.play.learn import learn
from piezod.experiment.play.task import KnownAxis, PlaySettings
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


def _active(
    device: object, emulator: LabJackServer | Gcs2Emulator, pair: ChannelPair, time: TestTime
) -> Connected:
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
