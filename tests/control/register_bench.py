"""A fault register for tests: it runs cycles with faults and collects the changes."""

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.faults.register import FaultRegister
from piezod.control.faults.table import Reaction, ids

PERIOD_NS = 1_000_000
SECOND = 1000
S5 = Detection(Fault.S5, 0, 4.0, 3.0)


class RegisterBench:
    """A register whose time advances by one period per cycle."""

    def __init__(self) -> None:
        self.register = FaultRegister(reset_after_cycles=SECOND)
        self.t_ns = 0
        self.changes: list[tuple[str, bool]] = []

    def cycle(self, *faults: Fault | Detection) -> Reaction:
        """Run a cycle in which these faults are detected; return the reaction."""
        self.t_ns += PERIOD_NS
        found = [Detection(fault) if isinstance(fault, Fault) else fault for fault in faults]
        reaction = self.register.update(found, self.t_ns)
        self.changes += [(news.rule.id, news.appeared) for news in self.register.news]
        return reaction

    def cycles(self, count: int, *faults: Fault) -> list[Reaction]:
        """Run cycles in each of which these faults are detected; return the reactions."""
        return [self.cycle(*faults) for _ in range(count)]

    @property
    def present(self) -> list[Fault]:
        """Ids of the faults that are present."""
        return ids(self.register.present)

    @property
    def latched(self) -> list[Fault]:
        """Ids of the faults that are latched."""
        return ids(self.register.latched)
