"""The Motor of pyepics: python -m … PREFIX.

Reads every field that it knows, moves an axis, and tries what must fail; prints in JSON what it
reports.
"""

import json
import sys
from typing import Any

from epics import PV, Motor, poll


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
        "stop and tweak": stop_and_tweak(motor, prefix),
    }


def stop_and_tweak(motor: Motor, prefix: str) -> dict[str, Any]:
    """Stop on the way to 20 µm, wait for the end, and tweak by 1 µm."""
    done: list[int] = []
    pv = PV(f"{prefix}.DMOV", callback=lambda value, **_: done.append(value))
    pv.wait_for_connection(timeout=10)
    motor.slew_speed = 4.0
    motor.move(20.0)
    while motor.get_position(readback=True) < 4.5:
        poll(0.01)
    motor.stop()
    while not motor.done_moving:
        poll(0.01)
    target, position = motor.get_position(), motor.get_position(readback=True)
    motor.slew_speed, motor.tweak_val = 200.0, 1.0
    tweaked = motor.tweak(wait=True, timeout=30)
    return {
        "target": target,
        "position": position,
        "tweaked": tweaked,
        "after": motor.get_position(),
        "done": done,
    }


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1])))
