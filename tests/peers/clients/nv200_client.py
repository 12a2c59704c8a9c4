"""The maker's client of an NV200/D: python nv200_client.py PORT.

Sets 20 and 40 V in open loop, and prints in JSON what the device at this serial port reports.
"""

import asyncio
import json
import sys
from typing import Any

from nv200.nv200_device import NV200Device
from nv200.serial_protocol import SerialProtocol
from nv200.shared_types import PidLoopMode

LEAST_UM = 1.0
"""Each step moves the stage by some µm."""


async def moved_beyond(device: NV200Device, position_um: float) -> float:
    """Return the position as soon as it is beyond another one, or the last of many readings."""
    found_um = position_um
    for _ in range(500):
        found_um = await device.get_current_position()
        if found_um > position_um + LEAST_UM:
            break
    return found_um


async def main(port: str) -> None:
    """Drive the device and print the report."""
    device = NV200Device(SerialProtocol(port))
    await device.connect()
    await device.pid.set_mode(PidLoopMode.OPEN_LOOP)
    report: dict[str, Any] = {"range": await device.get_voltage_range(), "set": [], "moved": []}
    before_um = await device.get_current_position()
    for voltage in (20.0, 40.0):
        await device.move_to_voltage(voltage)
        report["set"].append(await device.get_setpoint())
        before_um = await moved_beyond(device, before_um)
        report["moved"].append(before_um)
    report["closed"] = await device.pid.is_closed_loop()
    await device.close()
    print(json.dumps(report))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
