"""The promises of the page are those of the table, and each reaction is compared with its own."""

import re

import pytest

from tests.conftest import Reaction
from tests.fault_promises import PROMISES
from tests.faults import PAGE, promises_on_the_page

IDS = re.findall(r"^\| ([A-Z]\d+) \| ", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def test_each_id_of_the_page_has_a_promise() -> None:
    """No id is without a promise, and none is promised that the page does not explain."""
    assert set(PROMISES) == set(IDS)


def test_page_shows_the_promises_in_force() -> None:
    """`make faults` was run after the last change of a promise."""
    shown = [(fault, each.what, each.bound) for fault, each in PROMISES.items()]

    assert promises_on_the_page() == shown


def test_a_promise_has_one_clock() -> None:
    """A bound is in virtual time or on a wall clock."""
    assert [id_ for id_, each in PROMISES.items() if each.cycles and each.ms] == []


def test_reaction_beyond_its_cycles_fails(reaction: Reaction) -> None:
    """Virtual time is compared in each run, a wall clock by the command; a cause comes first."""
    reaction("L3", ms=10**9)

    with pytest.raises(AssertionError, match="S2: 6 of 5 cycles"):
        reaction("S2", cycles=6)
    with pytest.raises(AssertionError, match="S2: a reaction in cycle 0 has another cause"):
        reaction("S2", cycles=0)
