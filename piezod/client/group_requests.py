"""One request to several stages: if not all carry it out, it is taken back on those that did."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Final, NoReturn, TypeAlias, TypeVar

from piezod.client.arrival import ENDED_EARLY, LATE, LEASE_HELD, SUPERSEDED
from piezod.client.calls import Call
from piezod.client.parallel import Outcomes, in_parallel
from piezod.client.stage_client import StageClient
from piezod.errors import ClientError, GroupError, NotRunningError, RefusedError
from piezod.messages.answers import Lease, Status
from piezod.messages.endpoints import ANSWER_WITHIN_S, ENDPOINTS

ResultT = TypeVar("ResultT")
Act: TypeAlias = Callable[[str, StageClient], ResultT]
"""Sends a request to a stage, given its name and its client."""
Undo: TypeAlias = Callable[[StageClient, Status], str]
"""Takes a request back, given the status before it; returns what was done, empty for nothing."""

LOOK_WITHIN_S: Final = 2.0
"""Time for all stages to report the status, to give the lease, or to take a request back, in s."""
STOP_WITHIN_S: Final = 2.0
"""Time for all stages to accept a request towards safety, in s."""
_LEFT_ALONE: Final = (ENDED_EARLY, SUPERSEDED, LEASE_HELD)
"""Codes of the errors of a movement that has ended, or whose stage another client has now."""
_SURE: Final = (RefusedError, NotRunningError)
"""Errors after which a stage has surely not carried out the request."""


class GroupRequests:
    """Sends requests to the stages of a group.

    Args:
        group: Name of the group, for messages.
        connect: Returns the client of a stage, by its name; raises ClientError.
    """

    def __init__(self, group: str, connect: Callable[[str], StageClient]) -> None:
        self._group, self._connect = group, connect

    def each(
        self, what: str, stages: Iterable[str], act: Act[ResultT], within_s: float | None = None
    ) -> dict[str, ResultT]:
        """Send a request to all stages at the same time, and take nothing back.

        Args:
            what: Name of the request.
            stages: Names of the stages.
            act: Sends it.
            within_s: Longest time for all stages together, in s; None for `STOP_WITHIN_S`.

        Raises:
            GroupError: If a stage has not carried it out. All others have got it.
        """
        found = self._send(stages, act, STOP_WITHIN_S if within_s is None else within_s)
        if found.failed:
            done = ", ".join(found.done) or "no stage"
            raise self._error(what, found.failed, f"done on {done}")
        return found.done

    def all_or_none(
        self, what: str, before: Mapping[str, Status], act: Act[ResultT], undo: Undo
    ) -> dict[str, ResultT]:
        """Send a request to all stages at the same time.

        Args:
            what: Name of the request.
            before: Status of each stage, from `prepare`.
            act: Sends it.
            undo: Takes it back.

        Raises:
            GroupError: If a stage has not carried it out. On the others it is taken back.
        """
        found = self._send(before, act, ANSWER_WITHIN_S)
        if not found.failed:
            return found.done
        # A stage that did not answer may have carried it out.
        doubtful = [name for name, why in found.failed.items() if not isinstance(why, _SURE)]
        undone = self._send(
            [*found.done, *doubtful],
            lambda stage, client: undo(client, before[stage]),
            LOOK_WITHIN_S,
        )
        for name in doubtful:  # a refusal there means that there was nothing to take back
            if isinstance(undone.failed.get(name), RefusedError):
                del undone.failed[name]
        self._release(before)
        raise self._error(what, found.failed, _taken_back(undone))

    def end(self, what: str, stages: Iterable[str], failed: Mapping[str, ClientError]) -> NoReturn:
        """Hold the stages of a movement that has failed on some of them.

        A stage that has left the movement is left as it is, and so is one that another client has.
        If the movement only takes too long, all continue.

        Args:
            what: Name of the movement.
            stages: Names of its stages.
            failed: Why it has failed.

        Raises:
            GroupError: Always.
        """
        if all(why.code == LATE for why in failed.values()):
            raise self._error(what, failed, "all continue")
        ours = [each for each in stages if getattr(failed.get(each), "code", "") not in _LEFT_ALONE]
        held = self._send(ours, lambda _, client: client.hold(), STOP_WITHIN_S)
        parts = [f"{stage} held" for stage in held.done]
        for stage, why in held.failed.items():
            if not isinstance(why, RefusedError):  # a refusal means that nothing is driven
                parts.append(f"{stage} NOT held, {why.what}")
        raise self._error(what, failed, ", ".join(parts) or "nothing was changed")

    def prepare(self, what: str, stages: Iterable[str]) -> dict[str, Status]:
        """Take the leases of all stages; return the status of each before.

        Raises:
            GroupError: If a stage does not answer, or another client has its lease. Nothing has
                changed then.
        """
        looked = self._send(stages, _status, LOOK_WITHIN_S)
        if looked.failed:
            raise self._error(what, looked.failed, "nothing was changed")
        leases = self._send(looked.done, _lease, LOOK_WITHIN_S)
        if leases.failed:
            self._release({name: looked.done[name] for name in leases.done})
            raise self._error(what, leases.failed, "nothing was changed")
        return looked.done

    def _release(self, before: Mapping[str, Status]) -> None:
        """Release the leases that were free before."""
        free = [name for name, status in before.items() if status.lease is None]
        self._send(free, lambda _, client: client.release_lease(), LOOK_WITHIN_S)

    def _send(self, stages: Iterable[str], act: Act[ResultT], within_s: float) -> Outcomes[ResultT]:
        def send(stage: str) -> ResultT:
            return act(stage, self._connect(stage))

        return in_parallel({stage: partial(send, stage) for stage in stages}, within_s)

    def _error(self, what: str, failed: Mapping[str, ClientError], then: str) -> GroupError:
        reasons = "; ".join(f"{stage}: {error.what}" for stage, error in failed.items())
        remedies = dict.fromkeys(error.remedy for error in failed.values() if error.remedy)
        text = f"group {self._group}: {what} failed on {reasons} ({then})"
        return GroupError(text, "; ".join(remedies), failed)


def _status(_stage: str, client: StageClient) -> Status:
    return client.call(Call(ENDPOINTS["status"], answer_within_s=LOOK_WITHIN_S))


def _lease(_stage: str, client: StageClient) -> Lease:
    return client.renew_lease()


def _taken_back(undone: Outcomes[str]) -> str:
    parts = [f"{stage} {done}" for stage, done in undone.done.items() if done]
    parts += [f"{stage} NOT taken back, {why.what}" for stage, why in undone.failed.items()]
    return f"taken back: {', '.join(parts)}" if parts else "nothing was changed"
