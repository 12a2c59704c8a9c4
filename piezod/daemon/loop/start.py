"""The loop process before its first cycle: it waits for devices, and is already to be spoken to."""

from pathlib import Path
from typing import Final

from piezod.config.faults import Fault
from piezod.config.requests import Shutdown
from piezod.daemon.clock import Clock
from piezod.daemon.lock import Lock, device_lock
from piezod.daemon.loop.devices import Opening
from piezod.daemon.loop.loop import SupervisorWatch
from piezod.daemon.loop.publisher import Publisher
from piezod.devices.channels import Channels
from piezod.errors import AlreadyRunningError
from piezod.telemetry.mailbox import MailboxReader
from piezod.telemetry.record import StageEvent
from piezod.telemetry.requests_codec import decode
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word
from piezod.units import s_to_ns

_LOOK_EACH_S: Final = 0.02


def wait_for_lock(path: Path, shared: SharedMap, clock: Clock, within_s: float) -> Lock | None:
    """Take the lock of whoever has the devices, as a loop of an earlier run until it has ramped.

    Args:
        path: The locked file.
        shared: The memory shared with the supervisor, writable.
        clock: The clock of the loop.
        within_s: How long to wait, in s.

    Returns:
        The lock, to be held as long as the devices are used; None if the process is to end.

    Raises:
        AlreadyRunningError: If the other one does not end in time.
        OSError: If the file cannot be opened.
    """
    desk, end_ns = _Desk(shared), clock.now_ns() + s_to_ns(within_s)
    while True:
        now_ns = clock.now_ns()
        try:
            return device_lock(path)
        except AlreadyRunningError as error:
            if not desk.look(now_ns, str(error), "lock"):
                return None
            if now_ns > end_ns:
                raise
        clock.sleep_until_ns(now_ns + s_to_ns(_LOOK_EACH_S))


def wait_for_devices(channels: Channels, shared: SharedMap, clock: Clock) -> bool:
    """Open the devices; where one is absent, tell so and try again.

    Args:
        channels: The devices.
        shared: The memory shared with the supervisor, writable.
        clock: The clock of the loop.

    Returns:
        True once they are open and active, False if the process is to end.

    Raises:
        Exception: Whatever a driver raises that is no `DeviceError`.
    """
    opening = Opening(channels, clock)
    opening.start()
    desk = _Desk(shared)
    while opening.is_alive():
        opening.join(_LOOK_EACH_S)
        if opening.absent:
            desk.blind(clock.now_ns())
        if not desk.look(clock.now_ns(), opening.absent, "device", Fault.A1):
            opening.stop()
            return False
    if opening.crash is not None:
        raise opening.crash
    desk.opened(clock.now_ns())
    shared.words[Word.DEVICES_OPEN] = 1
    return True


class _Desk:
    """Answers the supervisor as long as there is no loop.

    Args:
        shared: The memory shared with it.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._publisher, self._mailbox = Publisher(shared), MailboxReader(shared)
        self._supervisor = SupervisorWatch(shared)
        self._told = ""
        shared.words[Word.LOOP_ASKABLE] = 1

    def blind(self, now_ns: int) -> None:
        """Tell that the loop is alive and its devices are absent."""
        self._publisher.waiting(now_ns)

    def look(self, now_ns: int, absent: str, kind: str, fault: str = "") -> bool:
        """Tell what is the matter, answer requests; return whether to go on.

        Args:
            now_ns: The present instant.
            absent: Why the devices cannot be used; empty as long as that is not known.
            kind: What kind of event that is.
            fault: Its fault.
        """
        if absent != self._told:
            self._told = absent
            self._publisher.events([StageEvent(now_ns, "error", kind, absent, fault)])
        why = absent or "the loop is starting; try again in some seconds"
        if number := self._mailbox.take_estop():
            self._mailbox.answer_estop(number, accepted=False, motion=0, why=why)
        while (taken := self._mailbox.take(now_ns)) is not None:
            number, payload = taken
            if _is_shutdown(payload):
                self._mailbox.answer(number, accepted=True, motion=0, why="")
                return False
            self._mailbox.answer(number, accepted=False, motion=0, why=why)
        return not self._supervisor.lost(now_ns, 0)

    def opened(self, now_ns: int) -> None:
        """Tell that the devices are there, where somebody was told that they are not."""
        if self._told:
            self._publisher.events([StageEvent(now_ns, "info", "device", "the devices are open")])


def _is_shutdown(payload: bytes) -> bool:
    try:
        return isinstance(decode(payload), Shutdown)
    except ValueError:
        return False
