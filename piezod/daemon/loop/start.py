"""The loop process before its first cycle: waits for the devices, already answers requests."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from piezod.config.faults import Fault
from piezod.daemon.clock import Clock
from piezod.daemon.lock import Lock, device_lock
from piezod.daemon.loop.devices import DeviceOpener
from piezod.daemon.loop.loop import SupervisorWatch
from piezod.daemon.loop.publisher import Publisher
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity
from piezod.errors import AlreadyRunningError
from piezod.messages.requests import Shutdown
from piezod.telemetry.mailbox import MailboxReader
from piezod.telemetry.record import StageEvent
from piezod.telemetry.requests_codec import decode
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.succession import succession_of
from piezod.telemetry.words import Word
from piezod.units import s_to_ns

_POLL_S: Final = 0.02


def wait_for_lock(path: Path, shared: SharedMap, clock: Clock, within_s: float) -> Lock | None:
    """Take the lock of the devices; an earlier loop process keeps it until it has ramped down.

    Args:
        path: The locked file.
        shared: The memory shared with the supervisor, writable.
        clock: The clock of the loop.
        within_s: Longest wait, in s.

    Returns:
        The lock, to be held as long as the devices are used; None if the process should end.

    Raises:
        AlreadyRunningError: If the other process does not end in time.
        OSError: If the file cannot be opened.
    """
    mailbox, end_ns = _StartupMailbox(shared), clock.now_ns() + s_to_ns(within_s)
    # Poll instead of blocking in `flock`: requests need answers meanwhile.
    while True:
        now_ns = clock.now_ns()
        try:
            return device_lock(path)
        except AlreadyRunningError as error:
            if not mailbox.serve(now_ns, str(error), "lock"):
                return None
            if now_ns > end_ns:
                raise
        clock.sleep_until_ns(now_ns + s_to_ns(_POLL_S))


def wait_for_devices(
    channels: Channels,
    shared: SharedMap,
    clock: Clock,
    known: Mapping[str, Identity] = MappingProxyType({}),
) -> bool:
    """Open the devices; if one is absent, report that and try again.

    Args:
        channels: The devices.
        shared: The memory shared with the supervisor, writable.
        clock: The clock of the loop.
        known: Identities of the devices of an earlier loop, by name. If that was a loop of the same
            daemon, another device counts as absent.

    Returns:
        True when they are open and active; False if the process should end.

    Raises:
        Exception: Any exception of a driver except `DeviceError`.
    """
    opener = DeviceOpener(channels, clock, known if succession_of(shared) else {})
    opener.start()
    mailbox = _StartupMailbox(shared)
    while opener.is_alive():
        opener.join(_POLL_S)
        if opener.absent:
            mailbox.report_blind(clock.now_ns())
        fault = Fault.B14 if opener.held else Fault.A1
        if not mailbox.serve(clock.now_ns(), opener.absent, "device", fault):
            opener.stop()  # not joined: the end of the process ends a driver that hangs
            return False
    if opener.crash is not None:
        raise opener.crash
    mailbox.report_open(clock.now_ns())
    shared.words[Word.DEVICES_OPEN] = 1
    return True


class _StartupMailbox:
    """Answers the supervisor before the first cycle.

    Args:
        shared: The memory shared with the supervisor.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._publisher, self._mailbox = Publisher(shared), MailboxReader(shared)
        self._supervisor = SupervisorWatch(shared)
        self._reported = ""
        shared.words[Word.LOOP_ASKABLE] = 1  # from here on the supervisor posts requests

    def report_blind(self, now_ns: int) -> None:
        """Report that the process is alive and its devices are absent."""
        self._publisher.waiting(now_ns)

    def serve(self, now_ns: int, absent: str, kind: str, fault: str = "") -> bool:
        """Report a new reason for waiting, and refuse requests; return whether the process goes on.

        Args:
            now_ns: The present instant.
            absent: Why the devices cannot be used; empty if that is not known yet.
            kind: Kind of the event that reports it.
            fault: Fault id of that event.
        """
        if absent != self._reported:  # one event for each new reason, not for each poll
            self._reported = absent
            self._publisher.events([StageEvent(now_ns, "error", kind, absent, fault)])
        why = absent or "the loop is starting; try again in some seconds"
        # Nothing is driven yet, so that there is nothing to stop.
        if number := self._mailbox.take_estop():
            self._mailbox.answer_estop(number, accepted=False, why=why)
        while (taken := self._mailbox.take(now_ns)) is not None:
            number, payload = taken
            if _is_shutdown(payload):  # the only request that needs no device
                self._mailbox.answer(number, accepted=True, why="")
                return False
            self._mailbox.answer(number, accepted=False, why=why)
        return not self._supervisor.lost(now_ns, 0)

    def report_open(self, now_ns: int) -> None:
        """Report that the devices are open, if their absence was reported before."""
        if self._reported:
            self._publisher.events([StageEvent(now_ns, "info", "device", "the devices are open")])


def _is_shutdown(payload: bytes) -> bool:
    try:
        return isinstance(decode(payload), Shutdown)
    except ValueError:
        return False
