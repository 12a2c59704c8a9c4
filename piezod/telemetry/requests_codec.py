"""Requests as bytes, for the mailbox.

The sender has validated them. To do that again would take the loop 5 ms for a path of 10 000
points, so they travel as objects, by `pickle`: 0.6 ms. That is right here and nowhere else: both
ends are the same program under the same user, and nobody else can write to the mapped file.
"""

import pickle

from piezod.config.requests import Goto, Request


def encode(request: Request) -> bytes:
    """Write a request."""
    return pickle.dumps(request, pickle.HIGHEST_PROTOCOL)


def decode(payload: bytes) -> Request:
    """Read what `encode` wrote; may be called in the loop, after `warm_up`."""
    request: Request = pickle.loads(payload)  # noqa: S301 - see above
    return request


def warm_up() -> None:
    """Go the whole way once, so that the first request finds everything in place."""
    decode(encode(Goto(position_um=0.0)))
