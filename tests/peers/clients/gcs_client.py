"""A client of pylablib for GCS controllers: python gcs_client.py PORT.

Moves a stage that is served at this TCP port, and prints in JSON what it reports.
"""

import json
import sys
import time
from typing import Any

from pylablib.devices import PhysikInstrumente

DEADLINE_S = 20.0
TARGETS_UM = (5.0, 12.5)


def arrived(device: Any, position_um: float) -> float:
    """Move to a position; return the measured one when the stage is on target."""
    device.move_to(position_um)
    deadline_s = time.monotonic() + DEADLINE_S
    while not device.query_axis("ONT?", kind="bool") and time.monotonic() < deadline_s:
        time.sleep(0.05)
    return float(device.get_position())


def run(port: int) -> dict[str, Any]:
    """Carry out the commands of a PIE516."""
    device = PhysikInstrumente.PIE516(("network", ("127.0.0.1", port)), auto_online=False)
    report: dict[str, Any] = {
        "id": device.get_id(),
        "axes": device.get_all_axes(),
        "servo": [device.is_servo_enabled()],
        "limits": [device.get_position_lower_limit(), device.get_position_upper_limit()],
    }
    device.move_to(5.0)
    report["errors"] = {"servo off": int(device.query("ERR?"))}
    report["servo"].append(device.enable_servo(True))
    report["reached"] = [arrived(device, position_um) for position_um in TARGETS_UM]
    report["speed"] = device.set_velocity(50.0)
    report["moved by"] = device.move_by(-2.5)
    report["voltage"] = device.get_voltage()
    device.move_to(99.0)
    report["errors"]["limits"] = int(device.query("ERR?"))
    device.stop()
    report["errors"]["stop"] = int(device.query("ERR?"))
    report["after stop"] = arrived(device, 3.0)
    report["errors"]["none"] = int(device.query("ERR?"))
    device.close()
    return report


if __name__ == "__main__":
    print(json.dumps(run(int(sys.argv[1]))))
