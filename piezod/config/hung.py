"""When a loop counts as hung, and devices for which it may wait that long."""

from typing import Final

from piezod.config.daemon import DaemonConfig

HUNG_S: Final = 2.0
"""A loop without a cycle for longer than this, in s, is killed. systemd's watchdog waits
longer: it is for a supervisor that hangs itself."""
HUNG_PERIODS: Final = 5
"""The same in periods; the longer time counts."""


def hung_after_s(period_s: float) -> float:
    """Return the time without a cycle after which a loop with this period is killed, in s."""
    return max(HUNG_S, HUNG_PERIODS * period_s)


def reply_warnings(config: DaemonConfig) -> tuple[str, ...]:
    """Return which devices the loop may await for so long that it is killed.

    A driver has an option `timeout_ms` if its calls wait for a reply.
    """
    hung_s = hung_after_s(1.0 / config.rate_hz)
    waits_ms = {
        name: float(getattr(device.options, "timeout_ms", 0.0))
        for name, device in config.devices.items()
    }
    return tuple(
        f"device {name}: timeout_ms {wait_ms:g} allows a missing reply to stop the loop for "
        f"{wait_ms / 1e3:g} s; a loop that stands still for {hung_s:g} s is killed (L3), and the "
        f"stage ramped down: use at most {hung_s / 2 * 1e3:g}"
        for name, wait_ms in waits_ms.items()
        if wait_ms > hung_s / 2 * 1e3
    )
