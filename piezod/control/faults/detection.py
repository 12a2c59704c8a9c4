"""A fault as a watch detects it, and as the register reports its changes."""

from typing import NamedTuple

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case
from piezod.control.faults.table import FaultRule


class Detection(NamedTuple):
    """A fault that a watch detects in this cycle; reported in every cycle in which it is there.

    Attributes:
        fault: The fault.
        axis: Index of the axis, -1 if the fault concerns all.
        measured: Measured value, NaN if there is none.
        limit: Limit of that value, NaN if there is none.
        case: Case of the fault.
    """

    fault: Fault
    axis: int = -1
    measured: float = float("nan")
    limit: float = float("nan")
    case: Case = Case.USUAL


class News(NamedTuple):
    """A fault that appeared, escalated or ended.

    Attributes:
        rule: Rule that holds now; after an escalation with the worse reaction and latch.
        detection: The last detection.
        appeared: Whether the fault appeared or escalated. Otherwise it is gone, and not latched.
    """

    rule: FaultRule
    detection: Detection
    appeared: bool
