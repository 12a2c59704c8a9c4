"""Options of a run, and the ways in which it may end."""

from enum import Enum
from typing import NamedTuple


class RunOptions(NamedTuple):
    """Options of the command line, besides the configuration."""

    strict_rt: bool = False  #: Whether arming is refused if the loop is not real-time.
    require_device: bool = False  #: Whether the run ends if a device is absent at the start.
    shadow: bool = False  #: Whether nothing is ever written.


class Ending(Enum):
    """How a run ended."""

    IN_ORDER = "in order"
    """The loop ramped down and ended on request."""
    ABSENT = "no device"
    """The loop ended on request, because a required device was absent."""
    UNSAFE = "unsafe"
    """The loop ended on request, but did not reach the safe voltage."""
    LOST = "lost"
    """The loop ended by itself, was killed, or did not end in time."""
