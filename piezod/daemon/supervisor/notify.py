"""Reports to systemd: ready, alive, reloading, stopping (see sd_notify(3))."""

import asyncio
import os
import socket
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Final

_FEED_S: Final = 0.1
"""Period of `fed`, in s."""


class Notifier:
    """Reports to the service manager; does nothing without one.

    Args:
        environ: The environment variables; `NOTIFY_SOCKET`, `WATCHDOG_USEC` and `WATCHDOG_PID` are
            used.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        address = environ.get("NOTIFY_SOCKET", "")
        # A leading @ stands for the zero byte of an address that is not in the file system.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self.watchdog_s = _watchdog_s(environ)
        """Period within which the manager expects `alive`, in s; 0 without a watchdog."""

    def ready(self, status: str) -> None:
        """Report that the start, or a reload, has ended; `status` is shown to people."""
        self._send("READY=1", f"STATUS={status}")

    def take_longer(self, within_s: float, status: str) -> None:
        """Extend the time-out of the present phase to this time, in s."""
        self._send(f"EXTEND_TIMEOUT_USEC={int(within_s * 1e6)}", f"STATUS={status}")

    def status(self, status: str) -> None:
        """Report the state, for people."""
        self._send(f"STATUS={status}")

    def alive(self) -> None:
        """Feed the watchdog."""
        if self.watchdog_s:
            self._send("WATCHDOG=1")

    def reloading(self) -> None:
        """Report that a reload begins; `ready` reports its end."""
        # systemd compares this with the instant of its own request.
        self._send("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self, status: str) -> None:
        """Report that the service is ending."""
        self._send("STOPPING=1", f"STATUS={status}")

    def _send(self, *lines: str) -> None:
        if not self._address:
            return
        message = "\n".join(line.replace("\n", " ") for line in lines).encode()
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            # A manager that does not listen must neither delay nor end the service; if it misses
            # `alive` for too long, it restarts the service anyway.
            sender.setblocking(False)
            try:
                sender.sendto(message, self._address)
            except OSError:
                return


@asynccontextmanager
async def fed(notifier: Notifier) -> AsyncIterator[None]:
    """Feed the watchdog while the block waits: it also counts while a service ends.

    A file may take longer to write than the watchdog allows. The stop time-out still applies.
    """

    async def feed() -> None:
        while True:
            notifier.alive()
            await asyncio.sleep(_FEED_S)

    feeding = asyncio.create_task(feed())
    try:
        yield
    finally:
        feeding.cancel()


def _watchdog_s(environ: Mapping[str, str]) -> float:
    # Children inherit the variables; the watchdog is for one process.
    meant_for_us = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    period_us = environ.get("WATCHDOG_USEC", "")
    return int(period_us) / 1e6 if meant_for_us and period_us.isdecimal() else 0.0


def without_manager(environ: Mapping[str, str]) -> dict[str, str]:
    """Return the environment for a child: only the service itself reports to the manager."""
    ours = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID")
    return {name: value for name, value in environ.items() if name not in ours}
