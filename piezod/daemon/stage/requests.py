"""Posts requests to the loop, and waits for its answers without blocking the event loop."""

import asyncio
import time
from collections.abc import Callable
from typing import Final

from piezod.config.waveforms.waveform import WaveformCostError
from piezod.control.stage.answer import Answer
from piezod.daemon.stage.errors import BadValueError, NoAnswerError, UnavailableError
from piezod.messages.requests import Disarm, Estop, Hold, Request, Shutdown, Stop
from piezod.telemetry.mailbox import EXPIRED, MailboxAnswer, MailboxFullError, MailboxWriter
from piezod.telemetry.requests_codec import encode
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

URGENT: Final = (Stop, Hold, Disarm, Shutdown)
EXPIRES_S: Final = 0.5
EXPIRES_PERIODS: Final = 4
"""A request expires if the loop has not taken it after this time, in s, or this many periods,
whichever is longer."""
_POLL_S: Final = 0.001


class LoopRequests:
    """The supervisor's side of the mailbox.

    Args:
        shared: The memory shared with the loop; this object is the only writer of its mailbox.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._mailbox, self._words = MailboxWriter(shared), shared.words
        periods_ns = EXPIRES_PERIODS * shared.layout.period_ns
        self._expires_ns = max(int(EXPIRES_S * NS_PER_S), periods_ns)

    async def ask(self, request: Request) -> Answer:
        """Execute a request in the loop; return the answer.

        Raises:
            BadValueError: If its waveforms are too large for the loop.
            UnavailableError: If too many requests wait already.
            NoAnswerError: If the loop does not take it in time. Then it is not executed, except an
                emergency stop, which the loop executes as soon as it can.
        """
        expires_ns = time.monotonic_ns() + self._expires_ns
        find: Callable[[int], MailboxAnswer | None]
        if isinstance(request, Estop):
            number, find = self._mailbox.post_estop(), self._mailbox.estop_answer
        else:
            number, find = self.post(request, expires_ns), self._mailbox.answer
        # Twice as long: the loop may take it at the last moment, and answers in the next cycles.
        while time.monotonic_ns() < expires_ns + self._expires_ns:
            found = find(number)
            if found is not None and found.why == EXPIRED:
                break
            if found is not None:
                return Answer(*found)
            await asyncio.sleep(_POLL_S)  # the loop only writes to memory, and wakes no process
        # A loop that still compiles its kernels takes no request.
        if not self._words[Word.LOOP_BEAT_NS]:
            raise NoAnswerError("the loop is starting", "try again in some seconds")
        what = f"the loop did not take the request within {self._expires_ns / NS_PER_S:g} s"
        raise NoAnswerError(what, "look at the log and at `piezod status`, then try again")

    def post(self, request: Request, expires_ns: int) -> int:
        """Post a request without waiting; return its number.

        Raises:
            BadValueError: If its waveforms are too large for the loop.
            UnavailableError: If too many requests wait already, or it is too large.
        """
        try:
            return self._mailbox.post(
                encode(request), expires_ns, urgent=isinstance(request, URGENT)
            )
        except WaveformCostError as error:
            raise BadValueError(error.what, error.remedy) from error
        except MailboxFullError as error:
            raise UnavailableError(str(error)) from error
