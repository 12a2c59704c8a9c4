"""How weights are found, and where thresholds are put."""

from enum import StrEnum


class Method(StrEnum):
    """How the weights of a model are found from a record."""

    LMS = "lms"
    """The paper's update, sample by sample, over the record several times."""
    LEAST_SQUARES = "least-squares"
    """All weights at once, over the whole record, such that an inverse exists."""


class Spacing(StrEnum):
    """Where the thresholds of the operators are."""

    EVEN = "even"
    """At equal distances, as in the paper."""
    GRADED = "graded"
    """Denser towards both ends, where a branch bends most: just after and just before a turn."""
    PLACED = "placed"
    """Denser where the branches of this stage bend most, as a first fit finds them."""
