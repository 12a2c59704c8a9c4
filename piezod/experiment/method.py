"""How weights are found."""

from enum import StrEnum


class Method(StrEnum):
    """How the weights of a model are found from a record."""

    LMS = "lms"
    """The paper's update, sample by sample, over the record several times."""
    LEAST_SQUARES = "least-squares"
    """All weights at once, over the whole record."""
