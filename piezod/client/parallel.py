"""Calls to several daemons at the same time, of which none waits for another."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

from piezod.errors import ClientError

ResultT = TypeVar("ResultT")
_NO_ANSWER: Final = (
    "try again; if the daemon hangs, end it by `kill -9`: its stage is ramped down, as a service "
    "by itself, otherwise by `piezod safe CONFIG`"
)


@dataclass(frozen=True)
class Outcomes(Generic[ResultT]):
    """What became of calls, by the names of the stages, in the order of the calls."""

    done: dict[str, ResultT] = field(default_factory=dict)  #: Results.
    #: Errors of the stages without a result.
    failed: dict[str, ClientError] = field(default_factory=dict)


def in_parallel(calls: Mapping[str, Callable[[], ResultT]], within_s: float) -> Outcomes[ResultT]:
    """Carry out calls in a thread each; a call that takes too long counts as failed, and goes on.

    Args:
        calls: Calls, by the names of the stages; each raises nothing but ClientError.
        within_s: Longest time for all of them together, in s.
    """
    found: dict[str, ResultT | ClientError] = {}

    def carry_out(name: str, call: Callable[[], ResultT]) -> None:
        try:
            found[name] = call()
        except ClientError as error:
            found[name] = error

    # Daemon threads: the end of the process does not wait for a daemon that hangs.
    threads = [threading.Thread(target=carry_out, args=each, daemon=True) for each in calls.items()]
    end_s = time.monotonic() + within_s
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(max(0.0, end_s - time.monotonic()))
    outcomes = Outcomes[ResultT]()
    for name in calls:
        result = found.get(name, _silent(within_s))
        if isinstance(result, ClientError):
            outcomes.failed[name] = result
        else:
            outcomes.done[name] = result
    return outcomes


def _silent(within_s: float) -> ClientError:
    return ClientError(f"the daemon did not answer within {within_s:g} s", _NO_ANSWER, "no_answer")
