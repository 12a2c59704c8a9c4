"""Which faults of `docs/faults.md` show on a PI controller."""

from typing import Final

SEES: Final = frozenset(
    {
        *("B1", "B2", "B3", "B5", "B6", "B7", "B10", "B14"),
        *("A1", "A2", "A3", "A8", "A12", "A13", "S10"),
    }
)
"""On either generation: the line's own, missing acknowledgements, errors told, the voltage."""
