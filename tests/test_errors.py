"""The tree of exceptions, and the text of configuration errors."""

import pickle

import pytest

from piezod import errors
from piezod.errors import ConfigError, PiezodError, Problem

NEGATIVE = Problem("a.yaml", 3, 7, "axes.x.limits.drive_max_v", "must be above 0 V (got -5)")
MISSING = Problem("a.yaml", 0, 0, "", "no such file")


def test_problem_is_one_line_that_an_editor_can_jump_to() -> None:
    """Place, path and text are separated by colons."""
    expected = "a.yaml:3:7: axes.x.limits.drive_max_v: must be above 0 V (got -5)"

    assert str(NEGATIVE) == expected


def test_problem_of_a_whole_file_has_no_position() -> None:
    """A problem of a whole file has neither line nor column."""
    assert str(MISSING) == "a.yaml: no such file"


def test_config_error_lists_all_problems() -> None:
    """Each problem has its own line, in the given order."""
    assert str(ConfigError(MISSING, NEGATIVE)) == f"{MISSING}\n{NEGATIVE}"


def test_config_error_survives_pickling() -> None:
    """An error raised in a worker process arrives complete."""
    copy = pickle.loads(pickle.dumps(ConfigError(MISSING, NEGATIVE)))  # noqa: S301 - our own bytes

    assert copy.problems == (MISSING, NEGATIVE)


ERRORS = [
    thing
    for thing in vars(errors).values()
    if isinstance(thing, type) and issubclass(thing, Exception)
]


@pytest.mark.parametrize("error", ERRORS)
def test_every_error_is_a_piezod_error_drawn_in_the_tree(error: type[Exception]) -> None:
    """One except clause catches all, and the tree in the module docstring is complete."""
    assert issubclass(error, PiezodError)
    assert errors.__doc__ is not None
    assert error.__name__ in errors.__doc__
