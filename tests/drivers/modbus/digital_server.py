"""A pymodbus server with registers, coils and discrete inputs, which counts what is asked."""

import threading
from asyncio import new_event_loop, run_coroutine_threadsafe
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice


class DigitalServer:
    """The server, which counts requests, with a coil 3 and a discrete input 5."""

    def __init__(self) -> None:
        self.high = False
        """Level of the discrete input."""
        self.asked = Counter[int]()
        """Requests by their function."""
        self.levels: list[bool] = []
        """Levels to which coils were set, in order."""
        self.gone = threading.Event()
        """Whether the server is to leave."""
        self.refuses = False
        """Whether coils are refused."""
        self.port = 0

    async def act(
        self,
        function: int,
        _start: int,
        _address: int,
        _count: int,
        registers: list[int],
        values: Any,
    ) -> ExcCodes | None:
        """Take a request; the server reads back what it has written, without values."""
        if function in {5, 6} and values is None:
            return None
        self.asked[function] += 1
        if function == 5:
            if self.refuses:
                return ExcCodes.ILLEGAL_ADDRESS
            self.levels.append(bool(values[0]))
        if function == 2:
            registers[0] = 0xFFFF if self.high else 0
        return None


@contextmanager
def digital_server() -> Iterator[DigitalServer]:
    """Run the server in a thread of its own."""
    here = DigitalServer()
    bits = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
    words = [SimData(0, values=[0] * 16, datatype=DataType.REGISTERS)]
    device = SimDevice(1, simdata=(bits, bits, words, words), action=here.act)
    loop = new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    async def start() -> ModbusTcpServer:
        server = ModbusTcpServer(device, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        return server

    try:
        server = run_coroutine_threadsafe(start(), loop).result(10)
        here.port = server.transport.sockets[0].getsockname()[1]  # type: ignore[attr-defined] # asyncio's
        yield here
        ending = server.shutdown()  # type: ignore[no-untyped-call] # theirs
        run_coroutine_threadsafe(ending, loop).result(10)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
