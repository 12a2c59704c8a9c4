"""The audit log behind a queue: a disk that stands still delays no request."""

import os
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import Final

from piezod.daemon.background import Background
from piezod.daemon.logging import logger
from piezod.daemon.stores.audit import AuditLog
from piezod.messages.stores import AuditLine

READ_S: Final = 1.0
"""Longest time for which a reader waits for the entries before it, in s."""


class AuditQueue:
    """Writes entries in a thread; if the disk takes none for long, drops and counts them.

    `write` never waits. The other methods may block on the disk: call them in a worker thread.
    """

    def __init__(self, audit: AuditLog) -> None:
        self._audit = audit
        self._entries = Background[Callable[[], None]](
            "audit", lambda write: write(), self._report_lost
        )

    def write(
        self, uid: int, user: str, client: str, what: str, accepted: bool, why: str = ""
    ) -> None:
        """Append an entry with the present time; arguments as for `AuditLog.write`."""
        now = datetime.now(UTC)
        self._entries.put(
            partial(self._audit.write, uid, user, client, what, accepted, why, when=now)
        )

    def last(self, number: int) -> tuple[AuditLine, ...]:
        """Return the newest entries, as `AuditLog.last` does."""
        self._entries.flush(READ_S)
        return self._audit.last(number)

    def sync(self) -> None:
        """Bring the entries to the disk."""
        self._audit.sync()

    def close(self) -> None:
        """Write and sync the entries, and close the file; call it once."""
        if self._entries.close():
            self._audit.close()
        else:  # the thread still uses the file
            logger("audit").error("audit entries lost", why="the disk does not respond")

    def _report_lost(self, lost: int) -> None:
        what = f"{lost} entries are missing before this one"
        why = "the disk took none for too long"
        self._audit.write(os.getuid(), "", "piezod", what, accepted=False, why=why)
