"""A fault as a watch detects it, and as the register reports its changes."""

from typing import NamedTuple

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case
from piezod.control.faults.table import FaultRule


class Detection(NamedTuple):
    """A fault that a watch detects in this cycle; reported in every cycle in which it is there."""

    fault: Fault  #: The fault.
    axis: int = -1  #: Index of the axis, -1 if the fault concerns all.
    measured: float = float("nan")  #: Measured value, NaN if there is none.
    limit: float = float("nan")  #: Limit of that value, NaN if there is none.
    case: Case = Case.USUAL  #: Case of the fault.


class News(NamedTuple):
    """A fault that appeared, escalated or ended."""

    rule: FaultRule  #: Rule that holds now; after an escalation with the worse reaction and latch.
    detection: Detection  #: The last detection.
    #: Whether the fault appeared or escalated. Otherwise it is gone, and not latched.
    appeared: bool
