import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.daemon import load_daemon
from piezod.devices import registry
from piezod.telemetry.arrays import record_dtype
from piezod.telemetry.layout import (
    AXIS_FIELDS,
    CYCLE_FIELDS,
    PAGE,
    RING_MAX_BYTES,
    Layout,
    body_format,
)
from piezod.telemetry.record import AxisRecord
from tests.telemetry.conftest import values_of

SIMULATED = Path(__file__).parents[2] / "config" / "simulated.yaml"
LAYOUTS = st.builds(
    Layout,
    axes=st.lists(st.text(min_size=1, max_size=20), min_size=1, max_size=16).map(tuple),
    capacity=st.integers(64, 300_000),
    period_ns=st.integers(50_000, 10**9),
)


@pytest.mark.parametrize("axes", [1, 2, 3, 16])
def test_struct_and_array_describe_the_same_record(axes: int) -> None:
    """A record packed by `struct` has the same fields as an array; the ends are aligned words."""
    dtype = record_dtype(axes)
    cycle, axis = values_of(CYCLE_FIELDS, 3), values_of(AXIS_FIELDS, 21)
    body = struct.pack(body_format(axes), *cycle, *axis * axes)

    record = np.frombuffer(bytes(8) + body + bytes(8), dtype)[0]

    names = [name for name in dtype.names or () if "gap" not in name]
    values = [record[name] for name in names if name not in {"seq", "end_seq", "axes"}]
    assert values == cycle
    for each in record["axes"]:
        kept = [each[name] for name in each.dtype.names if "gap" not in name]
        assert kept == axis
    assert dtype.itemsize % 8 == 0


def test_fields_of_an_axis_are_those_of_the_record_of_the_cycle() -> None:
    """They have the same order, so that the loop can pass them on unchanged."""
    names = [name for name, *_ in AXIS_FIELDS if "gap" not in name]

    assert names == list(AxisRecord._fields)


@given(layout=LAYOUTS)
def test_layout_is_restored_from_its_text(layout: Layout) -> None:
    """The header of the memory contains the layout."""
    assert Layout.load(layout.dump()) == layout


@given(layout=LAYOUTS)
def test_parts_begin_on_pages_and_do_not_overlap(layout: Layout) -> None:
    """Each part has its own pages, up to the end of the memory."""
    end = 0
    for part in layout.parts().values():
        assert part.start == end
        assert part.start % PAGE == 0
        end = -(-part.stop // PAGE) * PAGE

    assert layout.size == end


@pytest.mark.parametrize(("rate_hz", "seconds"), [(1.0, 64), (1000.0, 16), (20_000.0, 16)])
def test_ring_holds_sixteen_seconds(rate_hz: float, seconds: float) -> None:
    """Slow loops have at least 64 records; one axis fits at the highest rate."""
    config = load_daemon(SIMULATED, registry).model_copy(update={"rate_hz": rate_hz})

    layout = Layout.of(config)

    assert layout.capacity == pytest.approx(rate_hz * seconds, rel=0.05)
    assert layout.rate_hz == pytest.approx(rate_hz)
    assert layout.capacity * record_dtype(1).itemsize <= RING_MAX_BYTES
