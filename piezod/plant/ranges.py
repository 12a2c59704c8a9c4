"""What a parameter of the plant may be; every declaration of a parameter uses it."""

from typing import NamedTuple


class ParameterRange(NamedTuple):
    """Range, unit and meaning of a parameter; the options of the driver are made from it.

    Attributes:
        unit: Unit as printed; empty for a plain number.
        low: Smallest value that a configuration may give.
        high: Largest value that a configuration may give.
        about: Meaning of the parameter.
        varies: Whether it differs between specimens, that is with the seed.
    """

    unit: str
    low: float
    high: float
    about: str
    varies: bool = True
