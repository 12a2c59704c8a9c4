from random import Random

import pytest

from piezod.devices.bus.conversation import PATIENCE
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.options import ModbusOptions
from tests.drivers.modbus.emulated import TIMEOUT_S, emulated
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine

BOXES = ({"unit": 1, "profile": "waveshare-ai8b"}, {"unit": 2, "profile": "waveshare-ao8b"})
TIMEOUT_NS = round(TIMEOUT_S * 1e9)


class LateLine(EmulatedLine):
    """When switched to tardy, one reply in four is late by up to ten time-outs; order is kept."""

    random = Random(1)  # noqa: S311 - repeatable
    arrives_ns = 0
    tardy = False

    def comes(self, data: bytes, after_ns: int = 0) -> None:
        late = self.tardy and self.random.random() < 0.25
        delay_ns = round(self.random.uniform(0.5, PATIENCE) * TIMEOUT_NS) if late else after_ns
        before_ns = max(self.arrives_ns, self.now_ns())
        self.arrives_ns = max(before_ns, self.now_ns() + delay_ns)
        super().comes(data, self.arrives_ns - before_ns)


@pytest.mark.sees("modbus", "B5")
@pytest.mark.sees("modbus", "A1")
@pytest.mark.parametrize("n_outputs", [1, 3])
def test_acknowledged_value_is_in_force(n_outputs: int) -> None:
    """With late replies, an accepted write is in force, and samples belong to it.

    An input reads the effect of the output in force at that very instant, never of an earlier one.
    """
    names = [f"AO{i + 1}" for i in range(n_outputs)]
    options = ModbusOptions.model_validate({"units": BOXES, "port": "p", "silence_ms": 0.0})
    wiring = Wiring(("AI1",), tuple(names))
    device, line, rig = emulated(emulator.WAVESHARE, options, wiring, kind=LateLine)
    assert isinstance(line, LateLine)
    device.open()
    device.activate(line.now_ns())
    line.tardy = True
    taken = refused = seen = 0
    for number in range(1500):
        value = (number % 900) / 100
        if device.write([value] * n_outputs, line.now_ns()):
            taken += 1
            assert rig.drive_v == pytest.approx([15 * value] * n_outputs, abs=0.02)
        else:
            refused += 1
        (sample,) = device.read(line.now_ns())
        if sample.valid:
            seen += 1
            assert sample.position_um == pytest.approx(rig.drive_v[0] * 0.2 / 5, abs=2e-3)
        line.time.t_ns += 10 * MS
    assert min(taken, refused, seen) > 100
    assert DeviceFlag.LATE_REPLY in frozenset().union(*device.status(line.now_ns()))
