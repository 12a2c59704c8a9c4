"""Page faults and garbage collections in the loop are counted and reported."""

import gc
import resource
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from piezod.config.faults import Fault
from piezod.daemon.loop.counters import ProcessCounters
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word


@pytest.fixture
def shared(tmp_path: Path) -> SharedMap:
    """Return shared memory of one axis."""
    return create(tmp_path / "loop.map", Layout(("x",), 100, 1_000_000))


@pytest.fixture
def not_collecting() -> Iterator[None]:
    """Switch the garbage collector off, as the loop does."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.fault("L6")
@pytest.mark.usefixtures("not_collecting")
def test_a_collection_is_reported_once(shared: SharedMap) -> None:
    """A collection is a detection if the collector is off."""
    counters = ProcessCounters(shared.words)
    gc.collect(0)

    assert [found.fault for found in counters.publish()].count(Fault.L6) == 1
    assert Fault.L6 not in [found.fault for found in counters.publish()]
    assert shared.words[Word.GC_COLLECTIONS] == 1


@pytest.mark.fault("L8")
@pytest.mark.usefixtures("not_collecting")
def test_major_page_faults_are_reported(shared: SharedMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """A major page fault costs milliseconds."""
    used = SimpleNamespace(ru_minflt=1000, ru_majflt=4)
    monkeypatch.setattr(resource, "getrusage", lambda _who: used)
    counters = ProcessCounters(shared.words)
    used.ru_majflt += 3
    found = counters.publish()

    assert [(one.fault, one.measured) for one in found] == [(Fault.L8, 3)]
    assert shared.words[Word.MAJOR_FAULTS] == 3
