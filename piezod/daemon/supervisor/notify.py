"""What a service tells systemd: ready, alive, reloading, stopping (see sd_notify(3))."""

import os
import socket
import time
from collections.abc import Mapping


class Notifier:
    """Tells the service manager how the service is; does nothing where there is no manager.

    Args:
        environ: The environment variables, of which `NOTIFY_SOCKET`, `WATCHDOG_USEC` and
            `WATCHDOG_PID` are read.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        address = environ.get("NOTIFY_SOCKET", "")
        # A leading @ stands for the zero byte of an address that is not in the file system.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self.watchdog_s = _watchdog_s(environ)
        """Within which time the manager wants to hear from us, s; 0 where it does not."""

    def ready(self, status: str) -> None:
        """Say that the start, or a reload, is over; `status` is shown to people."""
        self._send("READY=1", f"STATUS={status}")

    def take_longer(self, within_s: float, status: str) -> None:
        """Say that what is going on may take so long, in s, whatever its unit allows."""
        self._send(f"EXTEND_TIMEOUT_USEC={int(within_s * 1e6)}", f"STATUS={status}")

    def status(self, status: str) -> None:
        """Say what the service does, for people."""
        self._send(f"STATUS={status}")

    def alive(self) -> None:
        """Feed the watchdog."""
        if self.watchdog_s:
            self._send("WATCHDOG=1")

    def reloading(self) -> None:
        """Say that a reload begins; `ready` says that it is over."""
        # systemd compares this with the instant at which it asked.
        self._send("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self, status: str) -> None:
        """Say that the service is on its way out."""
        self._send("STOPPING=1", f"STATUS={status}")

    def _send(self, *lines: str) -> None:
        if not self._address:
            return
        message = "\n".join(line.replace("\n", " ") for line in lines).encode()
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            # A manager that does not listen shall not hold up or end the service: what it misses
            # is its own judgement of our health, and that it acts on.
            sender.setblocking(False)
            try:
                sender.sendto(message, self._address)
            except OSError:
                return


def _watchdog_s(environ: Mapping[str, str]) -> float:
    meant_for_us = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    period_us = environ.get("WATCHDOG_USEC", "")
    return int(period_us) / 1e6 if meant_for_us and period_us.isdecimal() else 0.0


def without_manager(environ: Mapping[str, str]) -> dict[str, str]:
    """Return the environment for a child: only the service itself talks to its manager."""
    ours = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID")
    return {name: value for name, value in environ.items() if name not in ours}
