"""Reports to systemd."""

import asyncio
import os
import socket

import pytest

from piezod.daemon.supervisor.notify import Notifier, fed, without_manager
from tests.daemon.supervisor.manager import waiting


def test_messages_arrive(manager: socket.socket) -> None:
    """Each message is one datagram with one assignment per line."""
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "1000000"})

    notifier.ready("SAFE,\nall well")
    notifier.alive()
    notifier.take_longer(90.5, "ramping")
    notifier.stopping("ramping")

    assert notifier.watchdog_s == 1
    assert [manager.recv(200) for _ in range(4)] == [
        b"READY=1\nSTATUS=SAFE, all well",
        b"WATCHDOG=1",
        b"EXTEND_TIMEOUT_USEC=90500000\nSTATUS=ramping",
        b"STOPPING=1\nSTATUS=ramping",
    ]


def test_watchdog_is_fed_while_the_daemon_waits(manager: socket.socket) -> None:
    """A thread that takes as long as it likes ends no daemon; nothing is fed after the wait."""
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "1000000"})

    async def wait() -> list[bytes]:
        async with fed(notifier):
            return await asyncio.to_thread(lambda: [manager.recv(200) for _ in range(3)])

    got = asyncio.run(wait())

    assert got == [b"WATCHDOG=1"] * 3
    assert waiting(manager) == b""


def test_reload_reports_its_instant(manager: socket.socket) -> None:
    """Systemd expects the instant on the monotonic clock."""
    Notifier({"NOTIFY_SOCKET": manager.getsockname()}).reloading()

    first, second = manager.recv(200).split(b"\n")
    assert first == b"RELOADING=1"
    assert second.startswith(b"MONOTONIC_USEC=")


def test_abstract_address_is_understood() -> None:
    """An address with a leading @ is not in the file system."""
    name = f"piezod-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.settimeout(10)
        listener.bind("\0" + name)

        Notifier({"NOTIFY_SOCKET": "@" + name}).status("here")

        assert listener.recv(200) == b"STATUS=here"


@pytest.mark.parametrize("environ", [{}, {"NOTIFY_SOCKET": "/nowhere/at/all"}])
def test_missing_manager_is_no_error(environ: dict[str, str]) -> None:
    """Without a manager, or if it is gone, the daemon runs on."""
    Notifier(environ).ready("SAFE")


def test_watchdog_of_another_process_is_not_ours(manager: socket.socket) -> None:
    """Only the watched process feeds the watchdog."""
    environ = {
        "NOTIFY_SOCKET": manager.getsockname(),
        "WATCHDOG_USEC": "1000000",
        "WATCHDOG_PID": "1",
    }
    notifier = Notifier(environ)
    manager.setblocking(False)

    notifier.alive()

    assert notifier.watchdog_s == 0
    with pytest.raises(BlockingIOError):
        manager.recv(200)


def test_child_knows_no_manager() -> None:
    """A child must not report for the service."""
    assert without_manager({"NOTIFY_SOCKET": "@x", "WATCHDOG_USEC": "1", "A": "b"}) == {"A": "b"}
