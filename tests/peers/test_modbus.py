"""Modbus clients and servers by others: pyModbusTCP, modbus-tk, umodbus, minimalmodbus."""

import json
from pathlib import Path
from struct import pack, unpack
from typing import Any

import pytest

from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.modbus import emulator
from tests.drivers.modbus.emulated import served
from tests.drivers.modbus.pty_pair import wired_ports
from tests.drivers.modbus.test_peers import MAP, follows, options
from tests.peers.peer import run_peer, serving_peer

pytestmark = pytest.mark.peers

OVER_TCP = pytest.mark.parametrize("library", ["pyModbusTCP", "modbus_tk", "umodbus"])
OVER_RTU = pytest.mark.parametrize("library", ["minimalmodbus", "modbus_tk", "umodbus"])
HOLDING = tuple(dict(row, table="holding") for row in MAP)


def run_steps(library: str, where: str, *steps: tuple[object, ...]) -> list[Any]:
    """Run steps with a library, at a place that an emulation has printed."""
    results: list[Any] = run_peer("modbus_client.py", library, where, json.dumps(steps))
    return results


def float_words(value: float) -> list[int]:
    """Return a number as two registers."""
    return list(unpack(">HH", pack(">f", value)))


@OVER_TCP
@pytest.mark.parametrize("plugin", [emulator.LABJACK_T4, emulator.LABJACK_T7, emulator.LABJACK_T8])
@pytest.mark.confirms(
    "modbus",
    ("labjack-t4", "labjack-t7", "labjack-t8"),
    part="frames, FLOAT32 values in V",
    by="clients pyModbusTCP, modbus-tk, umodbus",
    kind="protocol",
)
def test_labjack_is_set_and_read(library: str, plugin: EmulatorPlugin) -> None:
    """A client sets DAC0 in V, reads it back, and reads AIN0, which follows it."""
    with served(plugin) as place:
        _, back, ain = run_steps(
            library,
            place,
            ("many", 1, 1000, float_words(2.0)),
            ("holding", 1, 1000, 2),
            ("holding", 1, 0, 2),
        )
    assert unpack(">f", pack(">HH", *back))[0] == pytest.approx(2.0, abs=1e-3)
    assert unpack(">f", pack(">HH", *ain))[0] > 1.0


@OVER_TCP
@pytest.mark.confirms(
    "modbus",
    "adam-6024",
    part="frames, tables of the values",
    by="clients pyModbusTCP, modbus-tk, umodbus",
    kind="protocol",
)
def test_adam_6024_is_set_and_read(library: str) -> None:
    """A client sets output 0 to 5 V, at 40011, and reads input 0 at 40001, without a status."""
    with served(emulator.ADAM_6024) as place:
        _, back, (code, status) = [
            *run_steps(library, place, ("one", 1, 10, 2048), ("holding", 1, 10, 1)),
            [
                each[0]
                for each in run_steps(library, place, ("holding", 1, 0, 1), ("holding", 1, 20, 1))
            ],
        ]
    assert back == [2048]
    assert code * 20 / 65_535 - 10 == pytest.approx(3.0, abs=0.01)
    assert status == 0


@OVER_TCP
@pytest.mark.confirms(
    "modbus",
    "wago-750",
    part="frames, tables of the values, constants",
    by="clients pyModbusTCP, modbus-tk, umodbus",
    kind="protocol",
)
def test_wago_is_set_and_read(library: str) -> None:
    """A client sets output 0, reads it back at 0x0200, the input, and the constants."""
    with served(emulator.WAGO_750) as place:
        _, (back,), (code,), constants = run_steps(
            library,
            place,
            ("many", 1, 0, [0x2000]),
            ("holding", 1, 0x200, 1),
            ("input", 1, 0, 1),
            ("holding", 1, 0x2002, 1),
        )
    assert back == pytest.approx(0x2000, abs=8)
    assert code == pytest.approx(0.6 * 0x2000, abs=16)
    assert constants == [0x1234]


@pytest.mark.confirms(
    "modbus", "wago-750", part="function 23", by="client pyModbusTCP", kind="protocol"
)
def test_wago_sets_and_reads_at_once() -> None:
    """Function 23 sets an output and returns the inputs, which do not repeat it."""
    with served(emulator.WAGO_750) as place:
        both = ("both", 1, 0, [0, [0x2000], 0, 2])
        _, (first, second) = run_steps("pyModbusTCP", place, both, both)
    assert first == pytest.approx(0.6 * 0x2000, abs=16)
    assert second != 0x2000


@OVER_RTU
@pytest.mark.confirms(
    "modbus",
    "adam-4024",
    part="frames, tables of the values, types, name",
    by="clients minimalmodbus, modbus-tk, umodbus",
    kind="protocol",
)
def test_adam_4024_is_set_and_read(library: str, tmp_path: Path) -> None:
    """A client sets output 0, reads it back, the types of all outputs, and the name."""
    port = str(tmp_path / "adam.tty")
    with served(emulator.ADAM_4024, port):
        _, back, types, name = run_steps(
            library,
            port,
            ("one", 1, 0, 3071),
            ("holding", 1, 0, 1),
            ("holding", 1, 200, 4),
            ("holding", 1, 210, 1),
        )
    assert (back, types, name) == ([3071], [0x32] * 4, [0x4024])


@OVER_RTU
@pytest.mark.confirms(
    "modbus",
    ("icpdas-m7017", "icpdas-m7024"),
    part="frames, tables of the values, coils",
    by="clients minimalmodbus, modbus-tk, umodbus",
    kind="protocol",
)
def test_icp_das_is_set_and_read(library: str, tmp_path: Path) -> None:
    """A client sets 5000 mV, reads it back and 3000 mV at the input, and the format."""
    port = str(tmp_path / "icpdas.tty")
    with served(emulator.ICPDAS, port):
        _, back, measured, (format_, *_) = run_steps(
            library,
            port,
            ("one", 2, 0, 5000),
            ("holding", 2, 0, 1),
            ("input", 1, 0, 1),
            ("coil", 1, 268, 1),
        )
    assert (back, measured, format_) == ([5000], [3000], 1)


@OVER_RTU
@pytest.mark.confirms(
    "modbus",
    ("waveshare-ai8b", "waveshare-ao8b"),
    part="frames, tables of the values, modes",
    by="clients minimalmodbus, modbus-tk, umodbus",
    kind="protocol",
)
def test_waveshare_is_set_and_read(library: str, tmp_path: Path) -> None:
    """A client sets two outputs at once, reads an input, and the modes of all inputs."""
    port = str(tmp_path / "waveshare.tty")
    with served(emulator.WAVESHARE, port):
        _, back, measured, modes = run_steps(
            library,
            port,
            ("many", 2, 0, [4000, 100]),
            ("holding", 2, 0, 2),
            ("input", 1, 0, 1),
            ("holding", 1, 0x1000, 8),
        )
    assert (back, measured, modes) == ([4000, 100], [2400], [0] * 8)


@pytest.mark.parametrize("library", ["pyModbusTCP", "modbus_tk"])
@pytest.mark.parametrize("functions", [(16,), (6, 16)])
@pytest.mark.confirms(
    "modbus",
    "registers",
    part="Modbus TCP: functions 3, 6, 16; types of numbers",
    by="servers pyModbusTCP, modbus-tk",
    kind="node",
)
def test_server_over_tcp(library: str, functions: tuple[int, ...]) -> None:
    """The driver reads and writes the registers of a server."""
    with serving_peer("modbus_server.py", library) as port:
        follows(
            options(
                registers=HOLDING,
                host="127.0.0.1",
                tcp_port=int(port),
                write_functions=functions,
                timeout_ms=2000.0,
            )
        )


@pytest.mark.parametrize("functions", [(16,), (6, 16)])
@pytest.mark.confirms(
    "modbus",
    "registers",
    part="Modbus RTU: functions 3, 6, 16; types of numbers",
    by="server modbus-tk",
    kind="node",
)
def test_server_over_rtu(functions: tuple[int, ...]) -> None:
    """The driver reads and writes the registers of a server over a serial line."""
    with wired_ports() as (ours, theirs), serving_peer("modbus_server.py", "modbus_tk", theirs):
        follows(
            options(
                registers=HOLDING,
                port=ours,
                baud=115_200,
                write_functions=functions,
                timeout_ms=2000.0,
            )
        )
