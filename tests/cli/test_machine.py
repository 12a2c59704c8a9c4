"""`piezod check --machine`."""

import json

import pytest

from tests.cli.conftest import Command
from tests.control.rig_stage import CONFIG


@pytest.mark.stress
def test_it_proposes_a_rate_that_the_cycle_allows(process: Command) -> None:
    """The proposal leaves room, all cycles of the paced part are counted, and the text has both."""
    code, out, _ = process("check", CONFIG, "--machine", "--json")
    found = json.loads(out)["machine"]

    assert code == 0
    assert 0 < found["rate_hz"] * found["cycle_us"] < 1e6 * found["throttle_part"]
    assert sum(found["late_us"].values()) > 100


def test_only_a_stage_can_be_measured(piezod: Command) -> None:
    """A model has no loop."""
    code, _, err = piezod("check", CONFIG.parent / "models/simulated-stack.yaml", "--machine")

    assert code == 2
    assert "--machine" in err
