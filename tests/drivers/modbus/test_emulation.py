from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.checksum import checksum
from tests.drivers.serial_line.linear_rig import bench

PLUGINS = [found for found in vars(emulator).values() if isinstance(found, EmulatorPlugin)]
TCP = [plugin for plugin in PLUGINS if plugin.wire == "tcp"]
SERIAL = [plugin for plugin in PLUGINS if plugin.wire == "serial"]


def tcp_answer(plugin: EmulatorPlugin, pdu: bytes) -> bytes:
    """Return the reply of a new device to a request over TCP, without its header."""
    assert plugin.create is not None
    frame = pack(">HHHB", 7, 0, len(pdu) + 1, 1) + pdu
    (reply,) = plugin.create(bench(1)[0], "").receive(frame)
    assert reply[:7] == pack(">HHHB", 7, 0, len(reply) - 6, 1)
    return reply[7:]


@pytest.mark.parametrize("plugin", TCP, ids=lambda plugin: plugin.name)
@given(st.sampled_from([1, 3, 4, 6, 16, 23, 0x4C]), st.binary(max_size=40))
def test_every_request_is_answered(plugin: EmulatorPlugin, function: int, data: bytes) -> None:
    """A request with any content gets its function code back, or an exception code."""
    answer = tcp_answer(plugin, bytes((function,)) + data)
    assert answer[0] == function or (answer[0] == function | 0x80 and answer[1] in {1, 2, 3, 4})


@pytest.mark.parametrize("plugin", SERIAL, ids=lambda plugin: plugin.name)
@given(st.sampled_from([1, 3, 4, 6, 16, 23]), st.binary(max_size=5), st.integers(1, 2))
def test_requests_in_pieces(plugin: EmulatorPlugin, function: int, data: bytes, cut: int) -> None:
    """Over a serial line a request may come in pieces, and only a complete one is answered."""
    assert plugin.create is not None
    device = plugin.create(bench(1)[0], "")
    frame = bytes((1, 3, 0, 210, 0, 1))
    frame += checksum(frame)
    assert device.receive(frame[:cut]) == []
    (reply,) = device.receive(frame[cut:])
    assert reply[0] == 1
    assert checksum(reply[:-2]) == reply[-2:]
    damaged = bytes((1, function)) + data
    assert all(answer[0] == 1 for answer in device.receive(damaged))


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [
        ("2b 0e 01 00", "ab 01"),  # no such function
        ("03 7530 0001", "83 02"),  # no such register
        ("03 03e8 0001", "83 02"),  # half of a number
        ("10 0000 0002 04 00000000", "90 02"),  # an input cannot be set
        ("03 03e8 0000", "83 03"),  # no register
        ("03 03e8 00", "83 03"),  # too short
        ("10 03e8 0002 04 7fc00000", "90 03"),  # not a number
        ("10 03e8 0002 05 7fc00000", "90 03"),  # a wrong number of bytes
        ("4c 02 03e8 02", "cc 03"),  # neither read nor write
        ("4c 00 03e8 02 01 03e8", "cc 03"),  # too short
    ],
)
def test_refusals(pdu: str, answer: str) -> None:
    """A LabJack refuses each faulty request with the right exception code."""
    found = tcp_answer(emulator.LABJACK_T7, bytes.fromhex(pdu.replace(" ", "")))
    assert found == bytes.fromhex(answer.replace(" ", ""))


def test_a_wrong_header_is_dropped() -> None:
    """An invalid header and the bytes behind it are dropped; the next request is answered."""
    assert emulator.LABJACK_T7.create is not None
    device = emulator.LABJACK_T7.create(bench(1)[0], "")
    assert device.receive(b"\0\1\0\1\0\6\1\3\0\0\0\2") == []
    assert len(device.receive(b"\0\1\0\0\0\6\1\3\0\0\0\2" * 2)) == 2


def test_an_amplifier_that_cannot_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    """A voltage that the rig cannot give is a failure of the device."""
    assert emulator.WAVESHARE.create is not None
    table, rig, _ = bench(1)
    monkeypatch.setattr(rig, "write", lambda _drive_v, _now_ns: False)
    device = emulator.WAVESHARE.create(table, "")
    frame = bytes((2, 6, 0, 0, 0x10, 0))
    (reply,) = device.receive(frame + checksum(frame))
    assert reply[:3] == bytes((2, 0x86, 4))
