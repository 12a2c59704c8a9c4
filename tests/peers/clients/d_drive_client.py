"""The maker's client of a d-Drive: python d_drive_client.py PORT.

Sets 40 V at channel 0 in open loop, and prints in JSON what the device at this serial port reports.
"""

import asyncio
import json
import sys
import time

from psj_lib import DDriveDevice, TransportType

DEADLINE_S = 20.0


async def main(port: str) -> None:
    """Drive the device and print the report."""
    device = DDriveDevice(TransportType.SERIAL, port)
    await device.connect()
    channel = device.channels[0]
    await channel.closed_loop_controller.set(False)
    rest = moved = await channel.position.get()
    await channel.setpoint.set(40.0)
    deadline_s = time.monotonic() + DEADLINE_S
    # The device refreshes its reading twice a second.
    while moved < rest + 1.0 and time.monotonic() < deadline_s:
        moved = await channel.position.get()
    report = {
        "channels": sorted(device.channels),
        "closed": await channel.closed_loop_controller.get_enabled(),
        "rest": rest,
        "moved": moved,
    }
    await device.close()
    print(json.dumps(report))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
