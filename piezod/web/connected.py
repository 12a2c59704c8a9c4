"""Answers that end when the client leaves."""

import asyncio
from collections.abc import Coroutine
from typing import Any


async def while_connected(
    serving: Coroutine[Any, Any, None],
    leaving: Coroutine[Any, Any, None],
    *expected: type[Exception],
) -> None:
    """Serve a client until that is done or it has left.

    Args:
        serving: Serves it; cancelled if it leaves.
        leaving: Ends when it leaves.
        expected: Errors of either that end it and are not raised.
    """
    tasks = asyncio.create_task(serving), asyncio.create_task(leaving)
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ended = await asyncio.gather(*tasks, return_exceptions=True)
    for each in ended:
        if isinstance(each, Exception) and not isinstance(each, expected):
            raise each
