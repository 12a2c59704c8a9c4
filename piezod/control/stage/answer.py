"""What becomes of a request."""

from typing import NamedTuple


class Answer(NamedTuple):
    """What becomes of a request.

    Attributes:
        accepted: Whether it is carried out.
        why: Why not, and what would help; empty where it is accepted.
        motion: Number of the movement that it started, 0 where it started none.
    """

    accepted: bool
    why: str = ""
    motion: int = 0
