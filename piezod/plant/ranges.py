"""What a parameter of the plant may be; every declaration of a parameter uses it."""

from typing import NamedTuple


class ParameterRange(NamedTuple):
    """Range, unit and meaning of a parameter; the options of the driver are made from it."""

    unit: str  #: Unit as printed; empty for a plain number.
    low: float  #: Smallest value that a configuration may give.
    high: float  #: Largest value that a configuration may give.
    about: str  #: Meaning of the parameter.
    varies: bool = True  #: Whether it differs between specimens, that is with the seed.
