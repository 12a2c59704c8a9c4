"""The ways in which an amplifier lies."""

from math import inf, nan
from typing import Final, Literal, NamedTuple

Output = Literal["follows", "stuck", "scaled", "late", "off"]
ReadBack = Literal["right", "stuck", "false", "scaled", "late"]


class Lie(NamedTuple):
    """What an amplifier does with its writes, and what it says about them."""

    output: Output = "follows"  #: What its output does.
    read_back: ReadBack = "right"  #: What is read back.
    value: float = nan  #: Of the one that lies: a voltage in V, a factor, or a delay in s.
    refuses: bool = False  #: Whether writes are refused meanwhile.
    #: Whether an output that was off stays at 0 V until the next write; otherwise it goes to the
    #: last write by itself.
    back_at_zero: bool = False
    lasts_s: float = inf  #: How long it lasts, if it ends by itself, in s.


HONEST: Final = Lie()
LIES: Final = {
    "output stuck": Lie("stuck"),
    "output scaled 0.8": Lie("scaled", value=0.8),
    "output late 0.2 s": Lie("late", value=0.2),
    "off 1 s, acknowledged, back at 0 V": Lie("off", back_at_zero=True, lasts_s=1.0),
    "off 1 s, acknowledged, back at the last write": Lie("off", lasts_s=1.0),
    "off 1 s, refused, back at 0 V": Lie("off", refuses=True, back_at_zero=True, lasts_s=1.0),
    "off 1 s, refused, back at the last write": Lie("off", refuses=True, lasts_s=1.0),
    "read-back stuck": Lie(read_back="stuck"),
    "read-back false 0 V": Lie(read_back="false", value=0.0),
    "read-back false 60 V": Lie(read_back="false", value=60.0),
    "read-back false 140 V": Lie(read_back="false", value=140.0),
    "read-back scaled 0.7": Lie(read_back="scaled", value=0.7),
    "read-back scaled 1.3": Lie(read_back="scaled", value=1.3),
    "read-back late 0.2 s": Lie(read_back="late", value=0.2),
}
"""By name."""
