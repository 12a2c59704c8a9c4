"""Our CANopen and slcan code with other implementations, in another process."""

import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import canopen
import pytest
from canopen.sdo.exceptions import SdoAbortedError

from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import Emulated, emulated
from tests.drivers.can_bus import canopen_node
from tests.drivers.can_bus.canopen_node import NODE, library_dictionary
from tests.drivers.can_bus.ports import free_port
from tests.drivers.can_bus.profiles import CANOPEN, CANOPEN_PDO, GROUP

CODES_PER_V = 3276.7


@pytest.fixture(scope="module", params=[(), ("sizeless",)], ids=["sized", "sizeless"])
def peer(request: pytest.FixtureRequest) -> Iterator[str]:
    """Serve a node of the canopen library in another process; return its place."""
    port = free_port()
    command = [sys.executable, canopen_node.__file__, GROUP, str(port), *request.param]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield f"udp:{GROUP}:{port}"
        process.communicate("")
    assert process.returncode == 0


@pytest.mark.confirms(
    "canopen",
    "canopen-401",
    part="SDO, NMT, heartbeat, process data, their mapping",
    by="node of the canopen library",
    kind="node",
)
@pytest.mark.parametrize("profile", [CANOPEN, CANOPEN_PDO], ids=["sdo", "pdo"])
def test_driver_drives_a_node_by_the_canopen_library(peer: str, profile: Any) -> None:
    """Our driver opens, sets up, drives, reads and reads back a node of the canopen library."""
    device = profile.maker(peer)()
    identity = device.open()
    device.activate(time.monotonic_ns())
    for volts in (1.0, -3.0, 8.0):
        now_ns = time.monotonic_ns()
        taken, (sample,) = device.exchange([volts], now_ns)

        assert taken
        assert sample.position_um == pytest.approx(volts / 2, abs=2 / CODES_PER_V)
        assert device.read_back(now_ns) == pytest.approx([volts], abs=1 / CODES_PER_V)
    assert not any(device.status(time.monotonic_ns()))
    device.close()
    assert identity.model == "piezod canopen-401"


@pytest.fixture(scope="module")
def ours() -> Iterator[Emulated]:
    """Serve our emulated node in another process."""
    with emulated(f"canopen-401=udp:{GROUP}:{free_port()}") as node:
        yield node


@pytest.fixture(scope="module")
def remote(ours: Emulated) -> Iterator[Any]:
    """Return our node as an object of the canopen library."""
    _, group, port = ours.where[0].split(":")
    network = canopen.Network()
    network.connect(interface="udp_multicast", channel=group, port=int(port), hop_limit=0, fd=False)
    node: Any = network.add_node(NODE, library_dictionary())
    node.sdo.RESPONSE_TIMEOUT = 10.0  # the library's default is too short for a busy machine
    yield node
    network.disconnect()


def test_our_node_answers_the_canopen_library(remote: Any) -> None:
    """The canopen library reads numbers and texts of our node and writes its objects."""
    assert remote.sdo.upload(0x1000, 0) == b"\x91\x01\x0c\x00"
    assert remote.sdo.upload(0x1008, 0) == b"piezod canopen-401"
    remote.sdo.download(0x6443, 2, b"\x01")
    assert remote.sdo.upload(0x6443, 2) == b"\x01"


@pytest.mark.confirms(
    "canopen",
    "canopen-401",
    part="abort codes",
    by="canopen library",
    kind="client",
)
@pytest.mark.parametrize(
    ("index", "number", "data", "code"),
    [
        (0x2000, 0, None, 0x0602_0000),
        (0x6411, 9, None, 0x0609_0011),
        (0x6401, 1, b"\0\0", 0x0601_0002),
        (0x6411, 1, b"\0", 0x0607_0013),
        (0x6411, 1, b"\0\0\0\0", 0x0607_0012),
        (0x1801, 2, b"\xf5", 0x0609_0030),
        (0x1601, 0, b"\0", 0x0800_0022),
    ],
)
def test_our_node_refuses_as_documented(
    remote: Any, index: int, number: int, data: bytes | None, code: int
) -> None:
    """An invalid access is refused with its abort code of CiA 301."""
    with pytest.raises(SdoAbortedError) as refusal:
        if data is None:
            remote.sdo.upload(index, number)
        else:
            remote.sdo.download(index, number, data)
    assert refusal.value.code == code


@pytest.mark.confirms(
    "canopen",
    "canopen-401",
    part="NMT, SYNC, heartbeat, process data, their mapping",
    by="canopen library",
    kind="client",
)
def test_canopen_library_drives_our_node(remote: Any) -> None:
    """The library's process data, heartbeat and NMT work with our node."""
    remote.nmt.state = "PRE-OPERATIONAL"
    remote.tpdo.read()
    remote.rpdo.read()
    report, drive = remote.tpdo[2], remote.rpdo[2]
    for pdo, index, kind in ((report, 0x6401, 1), (drive, 0x6411, 255)):
        pdo.clear()
        pdo.add_variable(index, 1)
        pdo.trans_type, pdo.enabled = kind, True
        pdo.save()
    remote.sdo.download(0x1017, 0, struct.pack("<H", 50))
    remote.nmt.state = "OPERATIONAL"
    eventually(lambda: remote.nmt.wait_for_heartbeat(5.0) == "OPERATIONAL")

    drive[0].raw = round(5 * CODES_PER_V)
    drive.transmit()
    volts: list[float] = []
    report.add_callback(lambda pdo: volts.append(pdo[0].raw / CODES_PER_V))

    def settled() -> bool:
        remote.network.sync.transmit()
        return bool(volts) and 2.0 < volts[-1] < 3.5  # 75 V are some 13 µm, at 5 µm per V

    eventually(settled)
    assert struct.unpack("<h", remote.sdo.upload(0x6411, 1))[0] == round(5 * CODES_PER_V)


@pytest.mark.confirms(
    "canopen", "canopen-401", part="slcan adapter", by="slcan of python-can", kind="protocol"
)
def test_python_can_speaks_to_our_adapter(tmp_path: Path) -> None:
    """python-can's slcan configures our adapter and exchanges frames with the node behind it."""
    with emulated(f"canopen-401={tmp_path / 'can.tty'}") as node:
        bus = can.Bus(
            interface="slcan",
            channel=node.where[0],
            bitrate=500_000,
            sleep_after_open=0,
            ignore_config=True,
        )
        request = bytes((0x40, 0x00, 0x10, 0, 0, 0, 0, 0))
        bus.send(can.Message(arbitration_id=0x605, data=request, is_extended_id=False))
        answer = eventually(lambda: _from(bus, 0x585))
        bus.shutdown()
    assert bytes(answer.data) == b"\x43\x00\x10\x00\x91\x01\x0c\x00"


def _from(bus: Any, identifier: int) -> Any:
    message = bus.recv(0.1)
    return message if message is not None and message.arbitration_id == identifier else None
