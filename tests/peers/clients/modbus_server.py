"""Modbus servers by others: python modbus_server.py LIBRARY [PATH].

Serves 64 holding registers of unit 1 at any free port of this machine, or at a serial port at
115200 bit/s. Prints the TCP port, or "ready", and ends when its standard input ends.
"""

import sys
from queue import SimpleQueue
from typing import Any

import modbus_tk.defines as tk
import serial
from modbus_tk.modbus_rtu import RtuServer
from modbus_tk.modbus_tcp import TcpServer
from pyModbusTCP.server import ModbusServer

N = 64
HOST = "127.0.0.1"


def main() -> None:
    """Serve until standard input ends."""
    library, *path = sys.argv[1:]
    server, where = SERVERS[library](*path)
    print(where, flush=True)
    sys.stdin.read()
    server.stop()


def _py_modbus_tcp() -> tuple[Any, int]:
    server = ModbusServer(HOST, 0, no_block=True)
    server.start()
    return server, server._service.socket.getsockname()[1]  # noqa: SLF001 - it has no other way


def _modbus_tk(path: str = "") -> tuple[Any, object]:
    server: Any
    if path:
        server = RtuServer(serial.Serial(path, 115_200), interchar_multiplier=10)
    else:
        server = _ListeningTcpServer(port=0, address=HOST)
    server.add_slave(1).add_block("words", tk.HOLDING_REGISTERS, 0, N)
    server.start()
    return server, "ready" if path else server.port.get()


class _ListeningTcpServer(TcpServer):  # type: ignore[misc] # it has no types
    """A server that passes on its port; it opens its socket in a thread of its own."""

    def __init__(self, port: int, address: str) -> None:
        super().__init__(port=port, address=address)
        self.port: SimpleQueue[int] = SimpleQueue()

    def _do_init(self) -> None:
        super()._do_init()
        self.port.put(self._sock.getsockname()[1])


SERVERS: dict[str, Any] = {"pyModbusTCP": _py_modbus_tcp, "modbus_tk": _modbus_tk}

if __name__ == "__main__":
    main()
