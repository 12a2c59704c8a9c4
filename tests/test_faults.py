"""Each reaction is compared with the promise of the page for its fault."""

import pytest

from tests.conftest import Reaction
from tests.faults import Result, with_measured

PAGE = """
| id | noticed | done | within (measured) |
| S2 | not a number | HOLD; resume | 5 cycles (4) |
| L3 | hung | killed | 2500 ms () beyond the ramp |
| C1 | malformed | refused | |
"""


def test_measured_times_are_written_where_a_time_is_promised() -> None:
    """The rest of the page stays."""
    written = with_measured(PAGE, {"S2": Result(1, 3), "L3": Result(1, 2100), "C1": Result(1)})

    assert written == PAGE.replace("(4)", "(3)").replace("()", "(2100)")


def test_reaction_beyond_its_cycles_fails(reaction: Reaction) -> None:
    """Virtual time is compared in each run, a wall clock by the command; a cause comes first."""
    reaction("L3", ms=10**9)

    with pytest.raises(AssertionError, match="S2: 6 of 5 cycles"):
        reaction("S2", cycles=6)
    with pytest.raises(AssertionError, match="S2: a reaction in cycle 0 has another cause"):
        reaction("S2", cycles=0)
