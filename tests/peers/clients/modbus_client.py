"""Modbus clients by others: python modbus_client.py LIBRARY WHERE STEPS.

WHERE is HOST:PORT or the path of a port at 9600 bit/s. STEPS is a list in JSON of [what, unit,
address, number of registers or values]. Prints the list of the results in JSON; a write has None.
"""

import json
import socket
import sys
from collections.abc import Callable
from typing import Any

import minimalmodbus
import modbus_tk.defines as tk
import serial
import umodbus.client.serial.rtu as umodbus_rtu
import umodbus.client.tcp as umodbus_tcp
from modbus_tk.modbus_rtu import RtuMaster
from modbus_tk.modbus_tcp import TcpMaster
from pyModbusTCP.client import ModbusClient

TIMEOUT_S = 10.0
Run = Callable[[str, int, int, Any], Any]
"""Runs a step."""
TK_FUNCTIONS = {
    "holding": tk.READ_HOLDING_REGISTERS,
    "input": tk.READ_INPUT_REGISTERS,
    "coil": tk.READ_COILS,
    "one": tk.WRITE_SINGLE_REGISTER,
    "many": tk.WRITE_MULTIPLE_REGISTERS,
}


def main() -> None:
    """Run the steps and print the results."""
    library, where, steps = sys.argv[1:]
    run = CLIENTS[library](where)
    results = [run(*step) for step in json.loads(steps)]
    print(json.dumps([list(each) if each else each for each in results]))


def _py_modbus_tcp(where: str) -> Run:
    host, _, port = where.rpartition(":")
    client = ModbusClient(host, int(port), timeout=TIMEOUT_S)

    def run(what: str, unit: int, address: int, value: Any) -> Any:
        client.unit_id = unit
        if what in {"one", "many"}:
            write = (
                client.write_single_register if what == "one" else client.write_multiple_registers
            )
            assert write(address, value), client.last_error_as_txt
            return None
        if what == "both":
            return client.write_read_multiple_registers(*value)
        read = {
            "holding": client.read_holding_registers,
            "input": client.read_input_registers,
            "coil": client.read_coils,
        }[what]
        return read(address, value)

    return run


def _modbus_tk(where: str) -> Run:
    if where.startswith("/"):
        master = RtuMaster(serial.Serial(where, 9600))
    else:
        host, _, port = where.rpartition(":")
        master = TcpMaster(host, int(port))
    master.set_timeout(TIMEOUT_S)

    def run(what: str, unit: int, address: int, value: Any) -> Any:
        if what in {"one", "many"}:
            master.execute(unit, TK_FUNCTIONS[what], address, output_value=value)
            return None
        return master.execute(unit, TK_FUNCTIONS[what], address, value)

    return run


def _umodbus(where: str) -> Run:
    library: Any = umodbus_tcp
    end: Any
    if where.startswith("/"):
        library, end = umodbus_rtu, serial.Serial(where, 9600, timeout=TIMEOUT_S)
    else:
        host, _, port = where.rpartition(":")
        end = socket.create_connection((host, int(port)), timeout=TIMEOUT_S)
    makers = {
        "holding": library.read_holding_registers,
        "input": library.read_input_registers,
        "coil": library.read_coils,
        "one": library.write_single_register,
        "many": library.write_multiple_registers,
    }

    def run(what: str, unit: int, address: int, value: Any) -> Any:
        result = library.send_message(makers[what](unit, address, value), end)
        return None if what in {"one", "many"} else result

    return run


def _minimalmodbus(where: str) -> Run:
    def run(what: str, unit: int, address: int, value: Any) -> Any:
        device = minimalmodbus.Instrument(where, unit)
        device.serial.baudrate, device.serial.timeout = 9600, TIMEOUT_S
        if what == "one":
            return device.write_register(address, value, functioncode=6)
        if what == "many":
            return device.write_registers(address, value)
        if what == "coil":
            return device.read_bits(address, value, functioncode=1)
        return device.read_registers(address, value, functioncode=3 if what == "holding" else 4)

    return run


CLIENTS = {
    "pyModbusTCP": _py_modbus_tcp,
    "modbus_tk": _modbus_tk,
    "umodbus": _umodbus,
    "minimalmodbus": _minimalmodbus,
}

if __name__ == "__main__":
    main()
