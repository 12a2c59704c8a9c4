"""Coils and discrete inputs as channels, against the server of pymodbus."""

from collections.abc import Iterator

import pytest
from pydantic import ValidationError

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Sample, Wiring
from piezod.devices.status import NO_FLAGS
from piezod_drivers.modbus.driver import channels_of, make_device, make_transactions
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.register import Register
from tests.drivers.modbus.digital_server import DigitalServer, digital_server

MAP = (
    {"channel": "drive", "role": "output", "address": 0, "range": (0.0, 100.0)},
    {"channel": "drive", "role": "read-back", "address": 0},
    {"channel": "shutter", "role": "output", "table": "coil", "address": 3},
    {"channel": "exposed", "role": "input", "table": "discrete", "address": 5},
)
WIRING = Wiring(("exposed",), ("drive", "shutter"))


@pytest.fixture
def server() -> Iterator[DigitalServer]:
    """Return a server that runs."""
    with digital_server() as server:
        yield server


def opened(server: DigitalServer) -> BusDevice:
    """Return an active device on the server."""
    options = ModbusOptions.model_validate(
        {"registers": MAP, "host": "127.0.0.1", "tcp_port": server.port, "timeout_ms": 1000.0}
    )
    assert "shutter" in channels_of(options).outputs
    device = make_device(options, WIRING, make_transactions(options))
    device.open()
    device.activate(0)
    return device


def test_coil_is_set_when_its_level_changes(server: DigitalServer) -> None:
    """A cycle without a change costs no request; the first one after opening sets it."""
    device = opened(server)
    levels = [0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    taken = [device.write([7.0, level], t) for t, level in enumerate(levels)]
    back = device.read_back(9)
    device.close()

    assert all(taken)
    assert server.levels == [False, True, False, True]
    assert server.asked[6] == len(levels)
    assert back[0] == 7.0


def test_discrete_input_is_read_as_a_number(server: DigitalServer) -> None:
    """It is 1 while it is high, and 0 otherwise."""
    device = opened(server)
    samples: list[Sample] = []
    for t, level in enumerate((False, True, True, False)):
        server.high = level
        samples += device.read(t)
    device.close()

    assert [sample.position_um for sample in samples] == [0.0, 1.0, 1.0, 0.0]
    assert all(sample.valid for sample in samples)


def test_refused_coil_concerns_no_voltage(server: DigitalServer) -> None:
    """The voltage is taken, the coil alone has a flag, and it is not asked in each cycle."""
    device = opened(server)
    server.refuses = True
    taken = [device.write([float(n), 1.0], n) for n in range(5)]
    flags, voltage = device.status(9), device.read_back(9)[0]
    asked = server.asked[5]
    device.close()

    assert all(taken)
    assert voltage == 4.0
    assert flags[:2] == [NO_FLAGS, NO_FLAGS]
    assert flags[2]
    assert asked < 5


@pytest.mark.parametrize(
    "wrong",
    [
        {"role": "output", "table": "discrete"},
        {"role": "output", "table": "coil", "range": (0.0, 1.0)},
        {"role": "input", "table": "discrete", "scale": 2.0},
        {"role": "input", "table": "coil", "type": "int16"},
    ],
)
def test_what_a_bit_cannot_be_is_refused(wrong: dict[str, object]) -> None:
    """Discrete inputs are not written, and a bit has neither scale nor type nor range."""
    with pytest.raises(ValidationError):
        Register.model_validate({"channel": "a", "address": 0, **wrong})
