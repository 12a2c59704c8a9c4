"""Methods to find the weights, and positions of the thresholds."""

from enum import StrEnum


class Method(StrEnum):
    """Method to find the weights of a model from a record."""

    LMS = "lms"
    """The update of the paper, eq. (29), sample by sample, several times over the record."""
    LEAST_SQUARES = "least-squares"
    """All weights at once over the whole record, such that an inverse exists."""
    SURFACE = "surface"
    """A forward model with a smooth Everett surface, inverted while it runs; beyond the paper."""


class Spacing(StrEnum):
    """Position of the thresholds of the operators."""

    EVEN = "even"
    """At equal distances, as in the paper, section 3."""
    GRADED = "graded"
    """Denser towards both ends, where a branch bends most: just after and just before a turn."""
    PLACED = "placed"
    """Denser where the branches of this stage bend most, by a first fit."""
