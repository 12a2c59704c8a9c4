"""What a run of a stage is given, and how it may end."""

from enum import Enum
from typing import NamedTuple


class RunOptions(NamedTuple):
    """What the command line adds to a configuration.

    Attributes:
        strict_rt: Whether arming is refused where the loop is not real-time.
        require_device: Whether to end where a device is absent at the start.
        shadow: Whether nothing is ever written.
    """

    strict_rt: bool = False
    require_device: bool = False
    shadow: bool = False


class Ending(Enum):
    """How a run ended."""

    IN_ORDER = "in order"
    """The loop ramped down and ended because it was asked to."""
    ABSENT = "no device"
    """Likewise, because a device was absent that had to be there."""
    UNSAFE = "unsafe"
    """The loop ended because it was asked to, and could not reach the safe voltage."""
    LOST = "lost"
    """The loop ended by itself, by violence, or not in time."""
