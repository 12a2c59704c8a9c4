"""Long answers to clients that may stop reading."""

import asyncio

from starlette.types import Message, Send

from piezod.daemon.service.peer_protocol import PeerProtocol


async def send_in_time(send: Send, message: Message, connection: PeerProtocol) -> bool:
    """Send a part of an answer; tells whether the client is still there.

    A client that has not read for 5 s is disconnected, and what was kept for him is dropped.
    """
    try:
        async with asyncio.timeout(connection.limits.blocked_s):
            await send(message)
    except TimeoutError:
        connection.abort()
        return False
    return not connection.closing.is_set()
