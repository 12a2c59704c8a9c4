"""A client over Channel Access, with the library of EPICS: aioca."""

import asyncio
import threading
from collections.abc import Coroutine
from typing import Any

from aioca import FORMAT_CTRL, FORMAT_TIME, caget, camonitor, caput

from tests.epics.clients.dialogue import converse, note, plain


class Aioca:
    """The client, in an event loop of its own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()

    def get(self, name: str) -> dict[str, Any]:
        value = self._do(caget(name, format=FORMAT_CTRL, timeout=20))
        answer = {"value": plain(value), "severity": value.severity}
        if hasattr(value, "units"):
            answer |= {"unit": value.units, "digits": getattr(value, "precision", 0)}
            answer |= {"low": value.lower_ctrl_limit, "high": value.upper_ctrl_limit}
        return answer

    def put(self, name: str, value: Any, *, wait: bool) -> None:
        self._do(caput(name, value, wait=wait, timeout=20))

    def watch(self, name: str, seen: list[dict[str, Any]]) -> None:
        async def begin() -> None:
            camonitor(
                name,
                lambda value: note(seen, value, value.severity),
                format=FORMAT_TIME,
                all_updates=True,
            )

        self._do(begin())

    def _do(self, work: Coroutine[Any, Any, Any]) -> Any:
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        error = future.exception()
        if error is not None:  # `result` does not raise an error that is false, as CANothing is
            raise error
        return future.result()


if __name__ == "__main__":
    converse(Aioca())
