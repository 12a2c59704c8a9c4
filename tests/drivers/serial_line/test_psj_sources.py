"""Driver and emulators agree with two programs by people of piezosystem jena for its devices.

These are `psj-lib` of the maker (`nv_family_channel.py`, `d_drive_device.py`) and micro-manager's
adapters `Piezosystem_NV40_3` and `Piezosystem_dDrive`, by an author at the maker. The tests hold
facts from them: commands, words of replies and bits.
"""

import pytest

from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PROFILES
from tests.drivers.serial_line.psj_rig import Rig

WITHOUT_CHANNEL = ("ERROR", "dspvmin", "dspvmax")
"""`GLOBAL_COMMANDS` of psj-lib: commands of an NV40/3 that name no channel."""
STATUS_REMOTE, STATUS_LOOP, STATUS_ACTOR = 0x0080, 0x0008, 0x8000
"""Bits of `stat,<ch>` in `Piezosystem_NV40_3.h`; the reply is `STATUS,<ch>,<decimal number>`."""


def test_nv40_is_asked_without_a_channel_where_the_maker_does() -> None:
    """An NV40/3 is asked for its limits and its errors without a channel."""
    rig = Rig("nv40")
    rig.device.open()
    opening = b"".join(rig.line.sent).decode()
    rig.device.activate(rig.now_ns())

    assert rig.device.capabilities().ranges == ((0.0, 130.0),)
    assert opening.count("dspvmin\r") == opening.count("dspvmax\r") == 1
    assert b"ERROR\r" in rig.line.sent
    assert not any(f"{name}," in opening for name in WITHOUT_CHANNEL)


@pytest.mark.parametrize("remote", [False, True])
@pytest.mark.parametrize("loop", [False, True])
def test_nv40_status_word_has_the_bits_of_micro_manager(*, remote: bool, loop: bool) -> None:
    """The emulated status word has the bits of the adapter, and the driver reads the same one."""
    emulator = Rig("nv40").emulator
    emulator.receive(b"setk,2,%d\rcloop,2,%d\r" % (remote, loop))
    (frame,) = emulator.receive(b"stat,2\r")
    word, channel, number = codec.text_of(frame).split(",")

    assert (word, channel) == ("STATUS", "2")
    assert bool(int(number) & STATUS_REMOTE) == remote == codec.is_remote(int(number))
    assert bool(int(number) & STATUS_LOOP) == loop
    assert int(number) & STATUS_ACTOR


def test_d_drive_lists_its_slots_as_the_maker_expects() -> None:
    """`stat` without a channel has a line for each of six slots, `stat,<ch>,…` for those in use."""
    rig = Rig("30dv")  # any profile with one axis; the device below has six slots
    emulator = type(rig.emulator)("ddrive", rig.bench, "")
    (frame,) = emulator.receive(b"stat\r\n")
    lines = frame.strip(b"\x13\x11").decode().splitlines()

    assert len(lines) == PROFILES["ddrive"].channels == 6
    assert [line.startswith(f"stat,{i},") for i, line in enumerate(lines)] == [True, *[False] * 5]
    assert all("unit" in line for line in lines[1:])


def test_d_drive_is_read_in_scientific_notation_too() -> None:
    """After `setf,<ch>,1`, which psj-lib sends to each channel, the driver reads the position."""
    rig = Rig("ddrive", "position")
    rig.send(b"setf,0,1\r\n")
    rig.rig.drive_v[0] = 50.0
    (frame,) = rig.emulator.receive(b"mess,0\r\n")
    assert b"e+0" in frame

    (sample,) = rig.started().read(rig.now_ns())
    assert sample.position_um == pytest.approx(rig.bench.position_um(0))
