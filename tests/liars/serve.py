"""The process of the lying amplifier.

`python -m tests.liars.serve PORT TRACE SPEAKS` serves a pty at PORT until its standard input ends.
Lines there change it: `lie NAME`, `honest`, `knob VOLTS` (a person sets the output), `mark TEXT`.
"""

import os
import select
import sys
import time
import tty
from pathlib import Path
from typing import Final

from tests.liars.amplifier import Amplifier
from tests.liars.controller import Controller
from tests.liars.lines import Lines

TICK_S: Final = 0.005
SPEAKS: Final[dict[str, type[Lines] | type[Controller]]] = {"lines": Lines, "gcs": Controller}


def main(port: Path, trace: Path, speaks: str) -> None:
    """Serve until standard input ends."""
    master, slave = os.openpty()
    tty.setraw(slave)
    port.symlink_to(os.ttyname(slave))
    with trace.open("w", buffering=1) as file:
        amplifier = Amplifier(file)
        speaker = SPEAKS[speaks](amplifier)
        print("serving", flush=True)
        while True:
            ready, _, _ = select.select([master, sys.stdin], [], [], TICK_S)
            speaker.advance(time.monotonic())
            if sys.stdin in ready:
                order = sys.stdin.readline()
                if not order:
                    return
                amplifier.tell(order.strip(), time.monotonic())
                print("done", flush=True)
            if master in ready:
                os.write(master, speaker.receive(os.read(master, 4096), time.monotonic()))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
