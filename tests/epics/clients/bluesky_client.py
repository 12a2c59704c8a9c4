"""A scan of Bluesky through the IOC, as docs/bluesky.md has it: python -m … PREFIX."""

import json
import sys
from typing import Any

from bluesky import RunEngine
from bluesky import plans as bp
from ophyd_async.core import init_devices
from ophyd_async.epics.motor import Motor


def run(prefix: str) -> list[float]:
    """Return the positions in the events of a scan."""
    engine = RunEngine()
    with init_devices():
        x = Motor(f"pva://{prefix}")
    positions: list[float] = []

    def take(name: str, document: dict[str, Any]) -> None:
        if name == "event":
            positions.append(document["data"]["x"])

    engine(bp.scan([x], x, 2.0, 20.0, 4), take)
    return positions


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1])))
