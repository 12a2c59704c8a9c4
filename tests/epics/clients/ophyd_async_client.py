"""The Motor of ophyd-async, over CA or PVA: python -m … PREFIX PROTOCOL.

Moves an axis, stops it, and tries what must fail; prints in JSON what it reports.
"""

import asyncio
import json
import sys
from typing import Any

from ophyd_async.core import observe_value
from ophyd_async.epics.motor import Motor


async def run(address: str) -> dict[str, Any]:
    """Carry out the commands of a scan."""
    motor = Motor(address, name="x")
    await motor.connect(timeout=30)
    read = await motor.read()
    settings = await motor.read_configuration()
    report: dict[str, Any] = {"read": sorted(read), "unit": settings["x-motor_egu"]["value"]}
    await motor.user_setpoint.set(1.0)  # `set` refuses to start beyond the limits, as noise is
    reached = []
    for position_um in (5.0, 12.5, 12.5, 3.0):
        await motor.set(position_um)
        reached.append(await motor.user_readback.get_value())
    report["reached"] = reached
    for name, target_um in (("beyond", 99.0), ("forced", 99.0)):
        try:
            await (motor.set(target_um) if name == "beyond" else motor.user_setpoint.set(target_um))
            report[name] = ""
        except Exception as error:  # noqa: BLE001 - its class is what is looked at
            report[name] = type(error).__name__
    await motor.velocity.set(2.0)
    status = motor.set(20.0)
    await wait_until_moving(motor)
    await motor.stop(success=False)
    try:
        await status
        report["stopped"] = True
    except Exception:  # noqa: BLE001 - its class is ophyd-async's business
        report["stopped"] = False
    await motor.velocity.set(200.0)
    await motor.set(4.0)
    report["after stop"] = await motor.user_readback.get_value()
    return report


async def wait_until_moving(motor: Motor) -> None:
    """Wait until the record says that a movement goes on."""
    async for done in observe_value(motor.motor_done_move, timeout=20):
        if not done:
            return


if __name__ == "__main__":
    print(json.dumps(asyncio.run(run(f"{sys.argv[2]}://{sys.argv[1]}"))))
