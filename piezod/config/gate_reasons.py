"""Why an identifier learns or pauses, by the texts that records and status use."""

from enum import StrEnum


class GateReason(StrEnum):
    """Whether the identifier learns from a sample, and if not, the first reason that applies."""

    OPEN = "learning"
    INVALID = "sample invalid"
    LATE = "sample late"
    SKIPPED = "periods skipped"
    LIMITED = "drive limited"
    STUCK = "sensor stuck"
    SPIKE = "spike"
    NOISY = "sensor noisier than usual"
    QUIET = "no excitation"
    REPEATED = "sample repeated"
    DOUBTED = "sensor in doubt"
