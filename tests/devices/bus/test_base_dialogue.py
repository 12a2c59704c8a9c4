"""What most dialogues do in the same way."""

import itertools
from collections.abc import Sequence

import pytest

from piezod.devices.bus.base_dialogue import BaseDialogue, StatusTurns
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring, faults
from piezod.devices.status import NO_FLAGS, DeviceFlag

PERIOD_NS = 100


class Exchanges:
    """A connection that notices a fault once."""

    def __init__(self) -> None:
        self.closed = False
        self.noticed = {DeviceFlag.GARBAGE}

    def close(self) -> None:
        self.closed = True

    def take_noticed(self) -> set[DeviceFlag]:
        noticed, self.noticed = self.noticed, set()
        return noticed


class OwnDialogue(BaseDialogue):
    """A dialogue with one input and one output, which counts the questions for the value."""

    def __init__(self, exchanges: Exchanges | None) -> None:
        self.exchanges = exchanges or Exchanges()
        super().__init__(Wiring.both("x"), self.exchanges, exchanges)
        self.asked = 0

    def open(self) -> Identity:
        return Identity("a", "b", "c", "d")

    def capabilities(self) -> Capabilities:
        return Capabilities(*self._wiring, read_back=True, max_rate_hz=1.0)

    def put(self, values: Sequence[float]) -> None:  # noqa: ARG002 - the interface's
        self._forget_in_force()

    def fail_beside(self, flag: DeviceFlag) -> None:
        self._note_unless_lost(LineFault(flag, "no status"))

    def _ask_in_force(self) -> list[float]:
        self.asked += 1
        return [float(self.asked)]


def test_value_in_force_is_asked_once_per_instant() -> None:
    """Another instant, or a setpoint at the same one, makes it ask again."""
    dialogue = OwnDialogue(None)

    found = [dialogue.in_force(1)[0], dialogue.in_force(1)[0], dialogue.in_force(2)[0]]
    dialogue.put([1.0])
    assert [*found, dialogue.in_force(2)[0]] == [1.0, 1.0, 2.0, 3.0]


def test_noticed_faults_are_its_own_and_those_of_the_exchanges() -> None:
    """Both are reported once; a dialogue without such exchanges has its own."""
    for exchanges, others in ((Exchanges(), {DeviceFlag.GARBAGE}), (None, set())):
        dialogue = OwnDialogue(exchanges)
        dialogue.fail_beside(DeviceFlag.LATE_REPLY)
        assert dialogue.take_noticed() == {DeviceFlag.LATE_REPLY} | others
        assert dialogue.take_noticed() == set()


def test_a_status_that_loses_the_device_is_raised() -> None:
    """Any other fault of a status is only noticed."""
    with pytest.raises(LineFault):
        OwnDialogue(None).fail_beside(DeviceFlag.DISCONNECTED)


def test_by_itself_it_changes_nothing() -> None:
    """It holds its outputs, has no flags, and closes its connection."""
    dialogue = OwnDialogue(None)
    dialogue.activate()
    dialogue.deactivate()
    dialogue.close()

    assert dialogue.flags() == [NO_FLAGS, NO_FLAGS]
    assert dialogue.sample(5) == (5, ())
    assert dialogue.exchanges.closed


@pytest.mark.parametrize("n_turns", [1, 2, 3])
def test_each_part_of_a_status_is_asked_once_per_period(n_turns: int) -> None:
    """The parts take turns, and no call asks two."""
    turns = StatusTurns(PERIOD_NS)
    asked = {now_ns: turns.due(now_ns, n_turns) for now_ns in range(3 * PERIOD_NS)}

    for part in range(n_turns):
        at_ns = [now_ns for now_ns, turn in asked.items() if turn == part]
        assert all(b - a <= PERIOD_NS for a, b in itertools.pairwise(at_ns))
        assert len(at_ns) >= 3


def test_a_status_without_parts_is_never_asked() -> None:
    """After a restart the next part is due at once, if there is one."""
    turns = StatusTurns(PERIOD_NS)

    assert turns.due(0, 0) is None
    assert [turns.due(0), turns.due(1)] == [0, None]
    turns.restart()
    assert turns.due(1) == 0


def test_unknown_fault_is_refused() -> None:
    """A plug-in cannot claim to see a fault that does not exist."""
    assert faults("A1 B3") == {"A1", "B3"}
    with pytest.raises(ValueError, match="Z9"):
        faults("A1 Z9")
