"""Clients of pylablib: python pylablib_client.py MODEL PORT.

MODEL is kpz101, e-516 or mdt693a; PORT is a serial port. Sets 5 and 12.5 V, except with e-516, and
prints in JSON what the device reports.
"""

import json
import sys
import time
from typing import Any

import serial
from pylablib.devices import PhysikInstrumente, Thorlabs

VOLTS = (5.0, 12.5)
NEAR_V = 0.5
DEADLINE_S = 20.0


def kpz101(port: str) -> dict[str, Any]:
    """Drive a KPZ101."""
    # The client switches wires that a pseudo-terminal lacks.
    setattr(serial.Serial, "setRTS", lambda _port, _on=True: None)  # noqa: B010 - typed without it
    device = Thorlabs.KinesisPiezoController(("serial", (port, 115_200)))
    device.enable_channel(True)
    device.set_voltage_source("software")
    report = {
        "model": device.get_device_info().model_no,
        "set": [device.set_output_voltage(volts) for volts in VOLTS],
        "enabled": device.is_channel_enabled(),
        "range": device.get_voltage_range(),
    }
    device.close()
    return report


def e_516(port: str) -> dict[str, Any]:
    """Drive an E-516, whose commands an E-816 has too."""
    device = PhysikInstrumente.PIE516(("serial", (port, 115_200)))
    device.enable_servo(False)
    report = {
        "id": device.get_id(),
        "axes": device.get_all_axes(),
        "servo": device.is_servo_enabled(),
        "moved": device.get_position(),
    }
    device.close()
    return report


def mdt693a(port: str) -> dict[str, Any]:
    """Drive an MDT693A."""
    device = Thorlabs.MDT69xA(("serial", (port, 115_200)))
    report = {
        "set": [reached(device, volts) for volts in VOLTS],
    }
    device.close()
    return report


def reached(device: Any, volts: float) -> float:
    """Set channel x; return its voltage when it is near, or at the deadline."""
    deadline_s = time.monotonic() + DEADLINE_S
    found: float = device.set_voltage(volts, channel="x")
    while abs(found - volts) > NEAR_V and time.monotonic() < deadline_s:
        found = device.get_voltage("x")
    return found


MODELS = {"kpz101": kpz101, "e-516": e_516, "mdt693a": mdt693a}

if __name__ == "__main__":
    print(json.dumps(MODELS[sys.argv[1]](sys.argv[2]), default=str))
