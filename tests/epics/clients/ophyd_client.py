"""ophyd's EpicsMotor, as scans of Bluesky use it: python -m … PREFIX.

Moves an axis, stops it, and tries what must fail; prints in JSON what it reports.
"""

import json
import sys
import time
from typing import Any

from ophyd import EpicsMotor


def run(prefix: str) -> dict[str, Any]:
    """Carry out the commands of a scan."""
    motor = EpicsMotor(prefix, name="x")
    motor.wait_for_connection(timeout=30)
    report: dict[str, Any] = {
        "limits": list(motor.limits),
        "unit": motor.egu,
        "digits": motor.precision,
    }
    reached = []
    for position_um in (5.0, 12.5, 12.5, 3.0):
        status = motor.move(position_um, wait=True, timeout=30)
        reached.append([status.success, motor.position])
    report["reached"] = reached
    try:
        motor.move(99.0, wait=True, timeout=5)
    except Exception as error:  # noqa: BLE001 - its class is what is looked at
        report["limits refused"] = type(error).__name__
    status = motor.move(20.0, wait=False)
    time.sleep(0.05)
    motor.stop()
    report["stopped"] = status.success
    report["moves after stop"] = motor.move(4.0, wait=True, timeout=30).success
    return report


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1])))
