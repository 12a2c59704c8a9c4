"""The levels of the lines of the loop, which its devices and the cycle share."""

from dataclasses import dataclass


@dataclass
class LineLevels:
    """Level of each line, in the order of the configuration."""

    #: Whether it is high: an input when it was read last, an output as the next write sets it.
    high: list[bool]
    unknown: list[bool]  #: Whether it could not be read, or set, when that was tried last.
