"""Where the IOC listens, over TCP and UDP, of IP 4 and 6."""

import socket
import struct
from collections.abc import Iterable, Iterator
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from tests.addresses import address_outside
from tests.daemon.daemons import Daemon
from tests.epics.processes import Ioc

pytestmark = pytest.mark.epics
LOOPBACK: Final = "127.0.0.1"
EVERYWHERE: Final = "0.0.0.0"  # noqa: S104 - what pvxs uses for searches
LISTEN: Final = "0A"
"""State of a TCP socket that listens, in /proc/net."""
SEARCH: Final = 3
"""Command of PVA."""
BIG_ENDIAN: Final = 0x80
"""Flag of a message of PVA."""
MUST_REPLY, UNICAST = 0x01, 0x80
"""Flags of a search."""


class Bound(NamedTuple):
    """A socket on which a process can be reached."""

    protocol: str
    address: str
    port: int


def bound_sockets(pid: int) -> Iterator[Bound]:
    """Yield the sockets of a process that listen (TCP) or are bound to a port (UDP)."""
    links = [each.readlink().name for each in Path(f"/proc/{pid}/fd").iterdir()]
    own = {link[8:-1] for link in links if link.startswith("socket:")}
    for protocol in ("tcp", "tcp6", "udp", "udp6"):
        lines = Path(f"/proc/net/{protocol}").read_text(encoding="ascii").splitlines()[1:]
        for row in map(str.split, lines):
            if row[9] in own and (row[3] == LISTEN or protocol.startswith("udp")):
                address, _, port = row[1].partition(":")
                yield Bound(protocol, _address(address), int(port, 16))


def reached(bound: Iterable[Bound], *protocols: str) -> set[tuple[str, int]]:
    """Return addresses and ports of the sockets of some protocols."""
    return {(each.address, each.port) for each in bound if each.protocol in protocols}


def _address(text: str) -> str:
    """Return an address of /proc/net, whose words of 4 bytes are in the order of this machine."""
    words = [int(text[i : i + 8], 16) for i in range(0, len(text), 8)]
    packed = struct.pack(f"={len(words)}I", *words)
    return str(IPv4Address(packed) if len(words) == 1 else IPv6Address(packed))


def first_answered(port: int, addresses: list[str]) -> str:
    """Search a record over PVA at each address, in this order; return the first that answers."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("", 0))
        client.settimeout(20.0)
        for number, address in enumerate(addresses):
            client.sendto(pva_search(number, client.getsockname()[1]), (address, port))
        answer = client.recv(4096)
    # Head of 8 bytes, name of the server of 12, then the number of the search.
    return addresses[int.from_bytes(answer[20:24], "big" if answer[2] & BIG_ENDIAN else "little")]


def pva_search(number: int, port: int) -> bytes:
    """Return a search for `rig:STATE` that the server has to answer to this port."""
    name = b"rig:STATE"
    body = struct.pack("<IB3x16sHB", number, MUST_REPLY | UNICAST, bytes(16), port, 1)
    body += b"\x03tcp" + struct.pack("<HIB", 1, 0, len(name)) + name
    return struct.pack("<BBBBI", 0xCA, 2, 0, SEARCH, len(body)) + body


def test_ioc_listens_on_this_computer_only(daemon: Daemon) -> None:
    """CA and PVA listen on loopback; PVA, whose search port is open, does not answer others."""
    outside = address_outside()
    ioc = Ioc(daemon.folder).up()
    try:
        bound = list(bound_sockets(ioc.process.pid))
        ca, pva, search = ports(ioc)
        answered = first_answered(search, [outside, LOOPBACK])
    finally:
        assert ioc.end() == 0

    assert reached(bound, "tcp", "tcp6") == {(LOOPBACK, ca), (LOOPBACK, pva)}
    of_searches = {each for each in reached(bound, "udp", "udp6") if each[1] in {ca, search}}
    assert of_searches == {(LOOPBACK, ca), (EVERYWHERE, search)}
    assert answered == LOOPBACK


def test_ioc_listens_on_the_interface_that_is_named(daemon: Daemon) -> None:
    """With an address of this computer CA and PVA listen there, and not on loopback."""
    outside = address_outside()
    ioc = Ioc(daemon.folder, "--interface", outside).up()
    try:
        bound = list(bound_sockets(ioc.process.pid))
        ca, pva, search = ports(ioc)
        answered = first_answered(search, [LOOPBACK, outside])
    finally:
        assert ioc.end() == 0

    assert reached(bound, "tcp", "tcp6") == {(outside, ca), (outside, pva)}
    assert answered == outside


def ports(ioc: Ioc) -> tuple[int, int, int]:
    """Return the ports of an IOC: of CA, of PVA, and of searches over PVA."""
    names = ("EPICS_CA_SERVER_PORT", "EPICS_PVAS_SERVER_PORT", "EPICS_PVAS_BROADCAST_PORT")
    ca, pva, search = (int(ioc.environ[name]) for name in names)
    return ca, pva, search
