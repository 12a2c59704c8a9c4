"""The driver and its emulated device in different processes."""

import time
from pathlib import Path

import pytest

from piezod.devices.interface import Wiring
from piezod_drivers.modbus.driver import make_device, make_transactions
from piezod_drivers.modbus.options import ModbusOptions
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import emulated


@pytest.mark.sees("modbus", "A9")
def test_a_labjack_makes_its_output_safe_when_its_driver_is_gone(tmp_path: Path) -> None:
    """One second after the driver's process has died the output is at the safe voltage."""
    trace = tmp_path / "trace.csv"
    with emulated("labjack-t7", arguments=("--trace", str(trace))) as devices:
        host, _, port = devices.where[0].rpartition(":")
        options = ModbusOptions.model_validate(
            {
                "profile": "labjack-t7",
                "host": host,
                "tcp_port": int(port),
                "timeout_ms": 1000.0,
                "watchdog": {"timeout_s": 1.0, "safe": 0.5},
            }
        )
        transactions = make_transactions(options)
        device = make_device(options, Wiring(("AIN0",), ("DAC0",)), transactions)
        device.open()
        device.activate(time.monotonic_ns())
        assert device.write([2.0], time.monotonic_ns())
        eventually(lambda: _wrote(60, _voltages(trace)))  # the watchdog may have changed it by now
        transactions.close()
        eventually(lambda: _wrote(15, _voltages(trace)[-1:]))
        device.close()


def _voltages(trace: Path) -> list[float]:
    """Return the voltages that were written, in V."""
    lines = trace.read_text(encoding="ascii").split("\n")[1:-1] if trace.exists() else []
    return [float(line.rpartition(",")[2]) for line in lines]


def _wrote(voltage_v: float, voltages: list[float]) -> bool:
    """Return whether one of them is this voltage."""
    return any(abs(each - voltage_v) < 0.05 for each in voltages)
