"""The emulated cubes at a pty, with thorlabs-apt-protocol and with our driver as the host."""

import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest
import thorlabs_apt_protocol as peer
from serial import Serial

from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.thorlabs_apt.driver import PLUGIN
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import Emulated, emulated
from tests.drivers.bus.checks import activates, starts

CUBE, HOST, CHANNEL = 0x50, 0x01, 1


@pytest.fixture(scope="module")
def cubes() -> Iterator[Emulated]:
    """Serve an amplifier and a strain gauge reader on one rig."""
    with emulated("kpz101", "ksg101") as served:
        yield served


class Host:
    """A program with thorlabs-apt-protocol at a port.

    Args:
        port: Path of the port.
    """

    def __init__(self, port: str) -> None:
        self._serial = Serial(port, 115_200, timeout=0.01)
        self._unpacker = peer.Unpacker(self._serial, on_error="raise")

    def __enter__(self) -> "Host":
        return self

    def __exit__(self, *_: object) -> None:
        self._serial.close()

    def put(self, message: bytes) -> None:
        self._serial.write(message)

    def ask(self, message: bytes, name: str) -> Any:
        """Return the next message with this name."""
        self.put(message)
        return eventually(lambda: next((each for each in self._unpacker if each.msg == name), None))


@pytest.mark.confirms(
    "thorlabs_apt",
    ("KPZ101", "KSG101"),
    part="identity, output voltage",
    by="thorlabs-apt-protocol",
    kind="client",
)
def test_host_drives_the_amplifier_and_reads_the_gauge(cubes: Emulated) -> None:
    """Thorlabs-apt-protocol identifies both cubes, sets a voltage, and the driver sees the motion.

    Its own request for readings, 0x07DE, is the maker's identifier of the reply.
    """
    amplifier, gauge = cubes.where
    with Host(gauge) as ksg:
        assert ksg.ask(peer.hw_req_info(CUBE, HOST), "hw_get_info").model_number.startswith(
            b"KSG101"
        )
        mode = ksg.ask(peer.pz_req_tsg_iosettings(CUBE, HOST), "pz_get_tsg_iosettings")
        assert mode.display_mode == 1
    options = AptOptions.model_validate({"port": gauge, "model": "KSG101", "timeout_ms": 100.0})
    reader: Any = PLUGIN.create(options, Wiring(("1",), ()), 1)
    with Host(amplifier) as kpz, closing(reader):
        eventually(lambda: starts(reader))
        at_rest_um = _position_um(reader)
        assert kpz.ask(peer.hw_req_info(CUBE, HOST), "hw_get_info").model_number.startswith(
            b"KPZ101"
        )
        kpz.put(peer.mod_set_chanenablestate(CUBE, HOST, CHANNEL, 1))
        kpz.put(peer.pz_set_positioncontrolmode(CUBE, HOST, CHANNEL, 1))
        kpz.put(peer.pz_set_outputvolts(CUBE, HOST, CHANNEL, 16_384))
        asked = kpz.ask(peer.pz_req_outputvolts(CUBE, HOST, CHANNEL), "pz_get_outputvolts")
        assert asked.voltage == 16_384
        eventually(lambda: _position_um(reader) > at_rest_um + 5.0)
        kpz.put(peer.pz_set_outputvolts(CUBE, HOST, CHANNEL, 0))


def _position_um(reader: Any) -> float:
    """Return the next position that a reader reports."""
    (sample,) = eventually(lambda: [s for s in reader.read(time.monotonic_ns()) if s.valid])
    position_um: float = sample.position_um
    return position_um


@pytest.mark.confirms(
    "thorlabs_apt", "KPZ101", part="status updates", by="thorlabs-apt-protocol", kind="client"
)
def test_host_gets_updates_as_long_as_it_wants_them(cubes: Emulated) -> None:
    """Statuses come until they are stopped, with state and voltage."""
    with Host(cubes.where[0]) as kpz:
        kpz.put(peer.mod_set_chanenablestate(CUBE, HOST, CHANNEL, 1))
        kpz.put(peer.pz_set_outputvolts(CUBE, HOST, CHANNEL, 0))
        update = kpz.ask(peer.hw_start_updatemsgs(CUBE, HOST), "pz_get_pzstatusupdate")
        assert update.enabled
        assert not update.control_mode
        eventually(lambda: abs(kpz.ask(b"", "pz_get_pzstatusupdate").output_voltage) < 200)
        kpz.put(peer.pz_ack_pzstatusupdate(CUBE, HOST) + peer.hw_stop_updatemsgs(CUBE, HOST))


@pytest.mark.sees("thorlabs_apt", "A7")
def test_amplifier_that_is_switched_off_and_on_is_reported(cubes: Emulated) -> None:
    """Our driver reports a restarted amplifier across processes; activated again, it obeys."""
    options = {"port": cubes.where[0], "model": "KPZ101", "timeout_ms": 100.0}
    device: Any = PLUGIN.create(AptOptions.model_validate(options), Wiring((), ("1",)), 1)
    with closing(device):
        eventually(lambda: starts(device))
        eventually(lambda: device.write([5.0], time.monotonic_ns()))
        cubes.faults("restart:now:0.1")
        seen: set[DeviceFlag] = set()

        def restarted() -> bool:
            device.write([5.0], time.monotonic_ns())
            seen.update(device.status(time.monotonic_ns())[0])
            return DeviceFlag.RESTARTED in seen

        eventually(restarted)
        cubes.faults()
        device.deactivate(time.monotonic_ns())
        eventually(lambda: activates(device))
        eventually(lambda: device.write([1.0], time.monotonic_ns()))
        eventually(lambda: not device.status(time.monotonic_ns())[0])
