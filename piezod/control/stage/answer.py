"""The answer to a request."""

from typing import NamedTuple


class Answer(NamedTuple):
    """Result of a request."""

    accepted: bool  #: Whether the request is carried out.
    why: str = ""  #: Reason of a refusal, and what would help; empty if it is accepted.
    motion: int = 0  #: Number of the movement that the request started, 0 if none.
    #: Time until it can be on target, in s: until its command is at the target, and the settling
    #: time.
    duration_s: float = 0.0

    @property
    def out_of_range(self) -> bool:
        """Whether a value of the request is the reason of the refusal, and not the state."""
        return "out of range (got" in self.why
