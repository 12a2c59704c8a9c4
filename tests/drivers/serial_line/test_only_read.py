"""Devices of which only inputs are used, as by `piezod probe`, are not changed."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.bus.dialogue import Dialogue
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.ascii_line.dialogue import AsciiDialogue
from piezod_drivers.serial_line.ascii_line.emulator import NanopositionerEmulator
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions
from piezod_drivers.serial_line.npoint_lc400.dialogue import Lc400Dialogue
from piezod_drivers.serial_line.npoint_lc400.emulator import Lc400
from piezod_drivers.serial_line.npoint_lc400.options import Lc400Options
from piezod_drivers.serial_line.pi_gcs1.dialogue import Gcs1Dialogue
from piezod_drivers.serial_line.pi_gcs1.emulator import EMULATOR as GCS1
from piezod_drivers.serial_line.pi_gcs1.options import Gcs1Options
from piezod_drivers.serial_line.pi_gcs2.dialogue import Gcs2Dialogue
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from piezod_drivers.serial_line.pi_gcs2.options import Gcs2Options
from piezod_drivers.serial_line.psj.dialogue import PsjDialogue
from piezod_drivers.serial_line.psj.emulator import PsjEmulator
from piezod_drivers.serial_line.psj.profiles import PROFILES, ProfileName
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.amplifier_dialogue import AmplifierDialogue
from piezod_drivers.serial_line.thorlabs_apt.codec import Id
from piezod_drivers.serial_line.thorlabs_apt.emulator import KpzEmulator
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from tests.drivers.bus.profiles import ASCII_DEMO
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

HELD_V = 33.0


class Case(NamedTuple):
    """A device, and the requests that must not be sent to it."""

    name: str  #: Name of the case.
    channel: str  #: Its input; "" if it has none.
    emulator: Callable[[SharedRig], Emulator]  #: Constructs the emulator.
    dialogue: Callable[[EmulatedLine, Wiring], Dialogue]  #: Constructs the dialogue.
    before: bytes  #: Changes at the device by its user, so that the driver could undo something.
    changing: Sequence[bytes]  #: Beginnings or parts of any request that changes outputs or modes.


def psj(profile: ProfileName, before: bytes) -> Case:
    """Return an amplifier of piezosystem jena that reads positions."""
    psj_profile = PROFILES[profile]._replace(reads="position")
    changing = (b"set,0,", b"setk", b"cl,0,", b"cl,1", b"i1", b"ol", b"modsrc,0", b"cloop,0,")
    return Case(
        f"psj {profile}",
        "ch0",
        lambda stand: PsjEmulator(profile, stand, ""),
        lambda line, wiring: PsjDialogue(line, psj_profile, wiring, (-20.0, 130.0), 0.05),
        before,
        changing,
    )


def gcs1(stand: SharedRig) -> Emulator:
    """Return an E-816."""
    assert GCS1.create is not None
    return GCS1.create(stand, "")


CASES = [
    psj("ddrive", b"cl,0,1\r\n"),
    psj("nv40", b"cloop,0,1\r"),
    psj("nv200", b"cl,1\r"),
    Case(
        "pi_gcs1",
        "A",
        gcs1,
        lambda line, wiring: Gcs1Dialogue(line, Gcs1Options(port="p"), wiring),
        b"SVO A1\n",
        (b"SVA A", b"SVO A"),
    ),
    Case(
        "pi_gcs2",
        "1",
        lambda stand: Gcs2Emulator(stand, ""),
        lambda line, wiring: Gcs2Dialogue(line, Gcs2Options(port="p"), wiring),
        b"ONL 1 0\n",
        (b"SVA 1", b"SVO 1", b"ONL 1"),
    ),
    Case(
        "npoint_lc400",
        "1",
        lambda stand: Lc400(stand, ""),
        lambda line, wiring: Lc400Dialogue(Lc400Options(port="p"), wiring, line),
        b"",
        (b"\xa2",),
    ),
    Case(
        "ascii",
        "X",
        lambda stand: NanopositionerEmulator(stand, ""),
        lambda line, wiring: AsciiDialogue(
            line,
            AsciiOptions.model_validate({"port": "p", "start": ({"send": "START"},), **ASCII_DEMO}),
            wiring,
        ),
        b"",
        (b"MOVE", b"START"),
    ),
    Case(
        "kpz101",
        "",
        lambda stand: KpzEmulator(stand, ""),
        lambda line, wiring: AmplifierDialogue(
            AptOptions.model_validate({"port": "p", "model": "KPZ101"}), wiring, line
        ),
        codec.short(Id.SET_CONTROL_MODE, 1, 2),
        [
            each.to_bytes(2, "little")
            for each in (Id.SET_OUTPUT, Id.SET_ENABLED, Id.SET_CONTROL_MODE, Id.SET_SOURCE)
        ],
    ),
]


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_a_device_that_is_only_read_is_not_changed(case: Case) -> None:
    """With inputs only, voltage, loop and modes stay, and only queries are sent."""
    stand, rig, time = bench()
    emulator = case.emulator(stand)
    emulator.receive(case.before)
    rig.drive_v[0] = HELD_V
    line = EmulatedLine(emulator, time)
    wiring = Wiring((case.channel,) if case.channel else (), ())
    device = BusDevice(case.name, case.dialogue(line, wiring))

    device.open()
    device.activate(time.now_ns())
    samples = [device.read(time.now_ns()) for _ in range(5)]
    device.read_back(time.now_ns())
    device.close()

    assert all(sample.valid for each in samples for sample in each)
    assert rig.drive_v == [HELD_V]
    assert not [sent for sent in line.sent if any(word in sent for word in case.changing)]
