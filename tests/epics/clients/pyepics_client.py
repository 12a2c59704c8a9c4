"""The Motor of pyepics: python -m … PREFIX.

Reads every field that it knows, moves an axis, and tries what must fail; prints in JSON what it
reports.
"""

import json
import sys
from typing import Any

from epics import Motor


def run(prefix: str) -> dict[str, Any]:
    """Read the fields, and move."""
    motor = Motor(prefix)
    pvs = {name: motor.PV(name, connect=False) for name in motor._alias.values()}  # noqa: SLF001
    pvs["able"] = motor.PV("disabled")
    missing = [name for name, pv in pvs.items() if not pv.wait_for_connection(timeout=10)]
    unread = [name for name, pv in pvs.items() if pv.get(timeout=10) is None]
    moves = [
        motor.move(5.0, wait=True, timeout=30),
        motor.move(2.5, relative=True, wait=True, timeout=30),
        motor.tweak(wait=True, timeout=30),
    ]
    reached = motor.get_position(readback=True)
    beyond = motor.move(99.0, wait=True, timeout=30)
    forced = motor.move(99.0, wait=True, timeout=30, ignore_limits=True)
    motor.move(20.0)
    motor.stop()
    return {
        "missing": missing,
        "unread": unread,
        "moves": moves,
        "reached": reached,
        "raw": motor.get_position(readback=True, raw=True) * motor.resolution,
        "dial": motor.get_position(readback=True, dial=True),
        "beyond": beyond,
        "forced": forced,
        "after stop": motor.move(4.0, wait=True, timeout=30),
    }


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1])))
