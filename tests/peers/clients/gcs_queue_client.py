"""A client of pylablib that sends many targets at once: python gcs_queue_client.py PORT END.

Then it stops the stage if END is `stop`, and closes its connection.
"""

import json
import sys

from pylablib.devices import PhysikInstrumente

QUEUED_UM = (20.0, 6.0) * 200
"""Far more targets than a stage takes while they are sent."""


def run(port: int, end: str) -> dict[str, int]:
    """Send the targets; return their number, and the error after a stop."""
    device = PhysikInstrumente.PIE516(("network", ("127.0.0.1", port)), auto_online=False)
    device.enable_servo(True)
    for position_um in QUEUED_UM:
        device.set_axis("MOV", position_um)
    report = {"sent": len(QUEUED_UM)}
    if end == "stop":
        device.stop()
        report["error"] = int(device.query("ERR?"))
    device.close()
    return report


if __name__ == "__main__":
    print(json.dumps(run(int(sys.argv[1]), sys.argv[2])))
