"""What a command of an emulated amplifier may contain."""

import re
from typing import Final

LIMIT_V: Final = 150.0
"""Position of the switch at the back."""
_NUMBER: Final = re.compile(r"[+-]?[0-9]{1,6}(\.[0-9]{0,9})?")


class RefusalError(Exception):
    """Raised if a command is refused, with the device's text."""


def volts(text: str, refusal: str) -> float:
    """Return a voltage that the amplifier can drive.

    Args:
        text: The number as received.
        refusal: Text of the device if it is none, or too high or too low.

    Raises:
        RefusalError: With this text.
    """
    if not _NUMBER.fullmatch(text) or not 0.0 <= float(text) <= LIMIT_V:
        raise RefusalError(refusal)
    return float(text)
