"""A node with a digital input and a digital output, on a virtual bus of python-can."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import can

BUS = "the lines of a test"
OPTIONS = f"""
      bus: {{interface: virtual, channel: {BUS}}}
      messages:
        Command: {{id: 0x201, bytes: 1, signals: {{Shutter: {{start: 3, bits: 1}}}}}}
        Poll: {{id: 0x202, bytes: 0}}
        Status: {{id: 0x203, bytes: 1, signals: {{Exposed: {{start: 0, bits: 1}}}}}}
      inputs: {{exposed: {{message: Status, signal: Exposed}}}}
      outputs: {{shutter: {{message: Command, signal: Shutter}}}}
      request: Poll
      timeout_ms: 500
"""


class CanLines:
    """The node."""

    def __init__(self) -> None:
        self.high, self.levels = False, list[bool]()
        self.gone = threading.Event()

    def serve(self, bus: can.BusABC) -> None:
        """Answer requests until it is gone."""
        while not self.gone.is_set():
            frame = bus.recv(0.02)
            if frame is not None and frame.arbitration_id == 0x201:
                self.levels.append(bool(frame.data[0] & 8))
            elif frame is not None and frame.arbitration_id == 0x202:
                data = bytes((int(self.high),))
                bus.send(can.Message(arbitration_id=0x203, data=data, is_extended_id=False))


@contextmanager
def can_lines() -> Iterator[tuple[CanLines, str]]:
    """Serve a node; yield it and the device of a configuration."""
    node = CanLines()
    with can.Bus(interface="virtual", channel=BUS) as bus:
        thread = threading.Thread(target=node.serve, args=(bus,))
        thread.start()
        try:
            yield node, f"\n    driver: can_dbc\n    options:{OPTIONS}"
        finally:
            node.gone.set()
            thread.join()
