import pytest

import piezod
from tests.trace_cycle import trace

pytestmark = pytest.mark.skipif(
    piezod.build() == "compiled", reason="compiled functions have no frames to trace"
)


def test_a_cycle_passes_through_few_files() -> None:
    """A reader opens at most 25 files, the driver and the simulated physics included."""
    assert len({step.file for step in trace()}) <= 25


def test_a_cycle_is_not_deep() -> None:
    """At most nine functions of ours run inside each other."""
    assert max(step.depth for step in trace()) <= 9
