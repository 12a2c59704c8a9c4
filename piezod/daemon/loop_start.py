"""The loop process before its first cycle: it waits for devices, and is already to be spoken to."""

from typing import Final

from piezod.config.requests import Shutdown
from piezod.control.stage_record import StageEvent
from piezod.daemon.clock import Clock
from piezod.daemon.loop import SupervisorWatch
from piezod.daemon.loop_devices import Opening
from piezod.daemon.publisher import Publisher
from piezod.devices.channels import Channels
from piezod.telemetry.mailbox import MailboxReader
from piezod.telemetry.requests_codec import decode
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

_LOOK_EACH_S: Final = 0.02


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
        if not desk.look(clock.now_ns(), opening.absent):
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

    def look(self, now_ns: int, absent: str) -> bool:
        """Tell what is the matter, answer requests; return whether to go on.

        Args:
            now_ns: The present instant.
            absent: Why the devices cannot be opened; empty as long as that is not known.
        """
        if absent:
            self._publisher.waiting(now_ns)
        if absent != self._told:
            self._told = absent
            self._publisher.events([StageEvent(now_ns, "error", "device", absent, "A1")])
        while (taken := self._mailbox.take(now_ns)) is not None:
            number, payload = taken
            if _is_shutdown(payload):
                self._mailbox.answer(number, accepted=True, motion=0, why="")
                return False
            why = absent or "the loop is starting; try again in some seconds"
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
