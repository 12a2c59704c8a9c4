"""The running stages of this machine, also those that hang."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from piezod.client.calls import Call
from piezod.client.parallel import in_parallel
from piezod.client.places import running_stages
from piezod.client.stage_client import StageClient
from piezod.messages.answers import Status
from piezod.messages.endpoints import ENDPOINTS

ANSWER_WITHIN_S: Final = 2.0


@dataclass(frozen=True, kw_only=True)
class ListedStage:
    """A stage of this machine."""

    name: str  #: Its name.
    socket: Path | None  #: Socket of its daemon; None if no daemon runs.
    status: Status | None = None  #: Its status; None if the daemon does not answer.
    why: str = ""  #: Why there is no status; empty if there is one.

    @property
    def lease_holder(self) -> str:
        """Who has the lease: the user, with the name of the client; empty if it is free."""
        lease = self.status.lease if self.status else None
        return str(lease.holder) if lease else ""


def list_stages(
    names: Iterable[str] | None = None, within_s: float = ANSWER_WITHIN_S
) -> list[ListedStage]:
    """Return stages of this machine; a daemon that hangs or does not run is the reason of its.

    Args:
        names: Names of the stages; None for all that run, by name.
        within_s: Longest time to wait for all daemons together, in s.
    """
    running = running_stages()
    wanted = list(running if names is None else names)
    sockets = {name: running[name] for name in wanted if name in running}
    calls = {name: partial(_status, socket, within_s) for name, socket in sockets.items()}
    found = in_parallel(calls, within_s)
    failed = {name: error.what for name, error in found.failed.items()}
    return [
        ListedStage(
            name=name,
            socket=sockets.get(name),
            status=found.done.get(name),
            why=failed.get(name, "" if name in running else "no daemon is running"),
        )
        for name in wanted
    ]


def _status(socket: Path, within_s: float) -> Status:
    client = StageClient(socket=socket)
    try:
        return client.call(Call(ENDPOINTS["status"], answer_within_s=within_s))
    finally:
        client.close()
