"""A board that boots whenever its port is opened is reached."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from piezod.devices import registry
from piezod.devices.bus.serial_line import SerialLine
from piezod.errors import DeviceUnavailableError
from tests.drivers.bus.profiles import PROFILES, Port, Profile
from tests.drivers.bus.wire import MS, Wire, wired

BOOT_NS = 2_000 * MS
BANNER = b"\x00\xff\r\nrst:0x1 POWERON\r\nfirmware 1.3.5 ready\r\n"
SERIAL = [each for each in PROFILES if isinstance(each.options, Port)]


class _Board:
    """A device that hears and says nothing for `boot_ns` after each opening, then a banner.

    Args:
        wire: The wire to it.
        boot_ns: How long it boots.
    """

    def __init__(self, wire: Wire, boot_ns: int) -> None:
        self._wire, self._boot_ns = wire, boot_ns
        self._ready_ns = self._banner_at_ns = 0
        self.openings = 0
        self.heard_early = 0
        """Number of requests that came while it booted."""

    def opened(self) -> None:
        self.openings += 1
        self._ready_ns = self._banner_at_ns = self._wire.now_ns + self._boot_ns

    def hear(self, data: bytes) -> None:
        if self._wire.now_ns < self._ready_ns:
            self.heard_early += 1
        else:
            self._wire.send(data)

    def say(self, within_ns: int) -> bytes:
        wire = self._wire
        if self._banner_at_ns:
            end_ns = min(wire.now_ns + within_ns, self._banner_at_ns)
            wire.wait(end_ns - wire.now_ns)
            wire.receive(0)  # a stream is silent, too
            if end_ns < self._banner_at_ns:
                return b""
            self._banner_at_ns = 0
            return BANNER
        return wire.receive(within_ns)


@contextmanager
def board(profile: Profile, boot_ns: int = BOOT_NS) -> Iterator[_Board]:
    """Let every port lead to such a board."""
    with wired(profile) as wire, pytest.MonkeyPatch.context() as patched:
        found = _Board(wire, boot_ns)

        def opened(line: SerialLine) -> None:
            found.opened()
            line._settle()  # noqa: SLF001 - the part of `open` that needs no port

        for line in (SerialLine, *SerialLine.__subclasses__()):
            patched.setattr(line, "open", opened)
            patched.setattr(line, "send", lambda _, data: found.hear(data))
            patched.setattr(line, "receive", lambda _, within_ns: found.say(within_ns))
        yield found


@pytest.mark.parametrize("profile", SERIAL, ids=lambda each: each.name)
def test_booting_board_is_reached_at_the_first_opening(profile: Profile) -> None:
    """The port stays open until the board has booted, and its banner is no identity."""
    with board(profile) as found:
        device = profile.maker("x", 20.0)()
        device.open()
        flags = device.status(0)
        device.close()

    assert found.openings == 1
    assert not any(flags)


@pytest.mark.parametrize("profile", SERIAL, ids=lambda each: each.name)
def test_settling_board_is_left_alone(profile: Profile) -> None:
    """With `settle_ms` nothing is sent while the board boots, for longer than it is tried else."""
    with board(profile, 4_000 * MS) as found:
        options = {**profile.options("x", 20.0), "settle_ms": 4_500.0}
        plugin = registry.load(profile.driver)
        device = plugin.create(plugin.options_model.model_validate(options), profile.wiring, 1)
        device.open()
        device.close()

    assert (found.openings, found.heard_early) == (1, 0)


@pytest.mark.parametrize("profile", SERIAL, ids=lambda each: each.name)
def test_silent_board_is_given_up(profile: Profile) -> None:
    """A board that never answers is unavailable after seconds, and its port is released."""
    with board(profile, 10**15) as found:
        device = profile.maker("x", 20.0)()
        with pytest.raises(DeviceUnavailableError):
            device.open()
        took_ns = found._wire.now_ns  # noqa: SLF001 - the time of this test

    assert found.openings == 1
    assert took_ns < 20_000 * MS
