"""Other implementations: libmodbus' server, mbpoll, pymodbus' server and client."""

import shutil
import subprocess
import threading
from asyncio import new_event_loop, run_coroutine_threadsafe
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.driver import make_device, make_transactions
from piezod_drivers.modbus.options import ModbusOptions
from tests.drivers.modbus.emulated import served
from tests.drivers.modbus.pty_pair import wired_ports

SOURCE = Path(__file__).parent / "libmodbus_server.c"
MAP = (
    {"channel": "a", "role": "output", "address": 0, "type": "int16", "scale": 1e-3,
     "range": (-10.0, 10.0)},
    {"channel": "b", "role": "output", "address": 1, "type": "float32", "range": (-10.0, 10.0)},
    {"channel": "c", "role": "output", "address": 3, "type": "float32", "words": "little",
     "range": (-10.0, 10.0)},
    {"channel": "a", "role": "read-back", "address": 0, "type": "int16", "scale": 1e-3},
    {"channel": "b", "role": "read-back", "address": 1, "type": "float32"},
    {"channel": "c", "role": "read-back", "address": 3, "type": "float32", "words": "little"},
    {"channel": "a", "role": "input", "table": "input", "address": 0, "type": "int16",
     "scale": 1e-3},
    {"channel": "b", "role": "input", "table": "input", "address": 1, "type": "float32"},
    {"channel": "c", "role": "input", "table": "input", "address": 3, "type": "float32",
     "words": "little"},
)  # fmt: skip
WIRING = Wiring(("a", "b", "c"), ("a", "b", "c"))
VALUES = [-1.25, 3.5, -7.0]


def need(*programs: str) -> None:
    """Skip the test if one of these is not installed."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


@pytest.fixture(scope="module")
def libmodbus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the server of libmodbus."""
    need("gcc")
    server = tmp_path_factory.mktemp("libmodbus") / "server"
    command = [
        shutil.which("gcc") or "",
        "-I/usr/include/modbus",
        "-o",
        str(server),
        str(SOURCE),
        "-lmodbus",
    ]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    if built.returncode:
        pytest.skip(f"libmodbus-dev is not installed: {built.stderr[:200]}")
    return server


def options(**chosen: object) -> ModbusOptions:
    """Return validated options."""
    return ModbusOptions.model_validate(chosen)


@contextmanager
def running(*command: str) -> Iterator[str]:
    """Run a server; yield the first line that it prints."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().strip()
        finally:
            server.kill()


def follows(chosen: ModbusOptions) -> None:
    """Drive three outputs of three types and check the inputs and the read-back."""
    device = make_device(chosen, WIRING, make_transactions(chosen))
    try:
        device.open()
        device.activate(0)
        for n in range(20):
            values = [value + 0.001 * n for value in VALUES]
            assert device.write(values, n)
            assert [sample.position_um for sample in device.read(n)] == pytest.approx(values)
            assert device.read_back(n) == pytest.approx(values)
            if isinstance(device, ExchangingBusDevice):
                taken, samples = device.exchange(VALUES, n)
                assert taken
                assert device.read_back(-n - 1) == pytest.approx(VALUES)
                assert len(samples) == len(VALUES)
            assert not any(device.status(n))
    finally:
        device.close()


@pytest.mark.confirms(
    "modbus",
    "registers",
    part="Modbus TCP: functions 3, 4, 6, 16, 23; types of numbers",
    by="libmodbus' server",
    kind="node",
)
@pytest.mark.parametrize("functions", [(16,), (6, 16), (16, 23)])
def test_libmodbus_over_tcp(libmodbus: Path, functions: tuple[int, ...]) -> None:
    """The driver reads and writes the registers of libmodbus' server over TCP."""
    with running(str(libmodbus), "tcp") as port:
        follows(
            options(
                registers=MAP,
                host="127.0.0.1",
                tcp_port=int(port),
                write_functions=functions,
                timeout_ms=1000.0,
            )
        )


@pytest.mark.confirms(
    "modbus",
    "registers",
    part="Modbus RTU: functions 3, 4, 6, 16, 23; types of numbers",
    by="libmodbus' server",
    kind="node",
)
@pytest.mark.parametrize("functions", [(16,), (6, 16), (16, 23)])
def test_libmodbus_over_rtu(libmodbus: Path, functions: tuple[int, ...]) -> None:
    """The driver reads and writes the registers of libmodbus' server over a serial line."""
    with wired_ports() as (ours, theirs), running(str(libmodbus), "rtu", theirs) as ready:
        assert ready == "ready"
        follows(
            options(
                registers=MAP,
                port=ours,
                baud=115_200,
                write_functions=functions,
                timeout_ms=1000.0,
            )
        )


def mbpoll(*words: str) -> list[str]:
    """Run mbpoll once; return the values that it prints."""
    need("mbpoll")
    finished = subprocess.run(
        [shutil.which("mbpoll") or "", "-q", "-1", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return [
        line.split("\t")[-1].strip() for line in finished.stdout.splitlines() if line[:1] == "["
    ]


@pytest.mark.confirms(
    "modbus", "labjack-t7", part="frames, FLOAT32 values in V", by="mbpoll", kind="protocol"
)
def test_mbpoll_over_tcp() -> None:
    """Mbpoll sets an output of the emulated LabJack in V and reads an input that follows it."""
    with served(emulator.LABJACK_T7) as place:
        at = ["-m", "tcp", "-p", place.rpartition(":")[2], "-0", "-B"]
        mbpoll(*at, "-t", "4:float", "-r", "1000", "127.0.0.1", "2")
        (back,) = mbpoll(*at, "-t", "4:float", "-r", "1000", "-c", "1", "127.0.0.1")
        (value,) = mbpoll(*at, "-t", "4:float", "-r", "0", "-c", "1", "127.0.0.1")
    assert float(back) == pytest.approx(2.0, abs=1e-3)
    assert float(value) == pytest.approx(2.4, abs=1e-3)


@pytest.mark.confirms(
    "modbus",
    ("waveshare-ai8b", "waveshare-ao8b"),
    part="frames, tables of the values",
    by="mbpoll",
    kind="protocol",
)
def test_mbpoll_over_rtu(tmp_path: Path) -> None:
    """Mbpoll sets an output of one emulated Waveshare module and reads an input of the other."""
    port = str(tmp_path / "box.tty")
    with served(emulator.WAVESHARE, port):
        at = ["-m", "rtu", "-b", "9600", "-P", "none", "-0"]
        mbpoll(*at, "-a", "2", "-t", "4", "-r", "0", port, "4000")
        assert mbpoll(*at, "-a", "2", "-t", "4", "-r", "0", "-c", "2", port) == ["4000", "0"]
        assert mbpoll(*at, "-a", "1", "-t", "3", "-r", "0", "-c", "1", port) == ["2400"]


@pytest.mark.confirms(
    "modbus",
    "wago-750",
    part="frames, function 23, exceptions",
    by="pymodbus' client",
    kind="protocol",
)
def test_pymodbus_client_over_tcp() -> None:
    """Pymodbus' client sets and reads the emulated WAGO coupler, also in one request."""
    with served(emulator.WAGO_750) as place:
        client = ModbusTcpClient("127.0.0.1", port=int(place.rpartition(":")[2]))
        try:
            assert client.connect()  # type: ignore[no-untyped-call] # theirs
            assert not client.write_registers(0, [0x3FF0]).isError()
            (back,) = client.read_holding_registers(0x200, count=1).registers
            assert back == pytest.approx(0x3FF0, abs=8)  # resolution of 12 bits
            answer = client.readwrite_registers(
                read_address=0, read_count=2, write_address=0, values=[0x2000]
            )
            assert len(answer.registers) == 2
            assert client.read_holding_registers(0x7000, count=1).exception_code == 2
        finally:
            client.close()  # type: ignore[no-untyped-call] # theirs


@pytest.mark.confirms(
    "modbus",
    ("icpdas-m7017", "icpdas-m7024"),
    part="frames, tables of the values",
    by="pymodbus' client",
    kind="protocol",
)
def test_pymodbus_client_over_rtu(tmp_path: Path) -> None:
    """Pymodbus' client sets and reads the two emulated ICP DAS modules."""
    port = str(tmp_path / "box.tty")
    with served(emulator.ICPDAS, port):
        client = ModbusSerialClient(port, baudrate=9600)
        try:
            assert client.connect()
            assert not client.write_register(0, 5000, device_id=2).isError()
            assert client.read_holding_registers(0, count=1, device_id=2).registers == [5000]
            assert client.read_input_registers(0, count=1, device_id=1).registers == [3000]
            assert client.read_coils(0x10C, count=1, device_id=1).bits[0]
        finally:
            client.close()  # type: ignore[no-untyped-call] # theirs


@contextmanager
def pymodbus_server() -> Iterator[int]:
    """Run pymodbus' server in a thread of its own; yield its port."""
    loop = new_event_loop()
    device = SimDevice(1, simdata=[SimData(0, values=[0] * 64, datatype=DataType.REGISTERS)])
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    async def start() -> ModbusTcpServer:
        server = ModbusTcpServer(device, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        return server

    try:
        server = run_coroutine_threadsafe(start(), loop).result(10)
        yield server.transport.sockets[0].getsockname()[1]  # type: ignore[attr-defined] # asyncio's
        ending = server.shutdown()  # type: ignore[no-untyped-call] # theirs
        run_coroutine_threadsafe(ending, loop).result(10)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


@pytest.mark.confirms(
    "modbus",
    "registers",
    part="Modbus TCP: functions 3, 6, 16; types of numbers",
    by="pymodbus' server",
    kind="node",
)
def test_pymodbus_server() -> None:
    """The driver reads and writes the registers of pymodbus' server."""
    with pymodbus_server() as port:
        registers = tuple(dict(row, table="holding") for row in MAP)
        follows(options(registers=registers, host="127.0.0.1", tcp_port=port, timeout_ms=1000.0))
