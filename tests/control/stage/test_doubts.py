"""Tests of the reports of a doubt: few, however often the evidence changes, and with an end."""

from itertools import cycle, islice
from math import nan

import pytest

from piezod.control.in_force import InForce, Source
from piezod.control.stage.doubts import OVER_NS, AxisDoubt
from piezod.units import NS_PER_S

MS = NS_PER_S // 1000
FOUND = {
    Source.UNKNOWN: InForce(nan, Source.UNKNOWN, "unknown"),
    Source.WRITTEN: InForce(1.0, Source.WRITTEN, "written"),
    Source.READ_BACK: InForce(2.0, Source.READ_BACK, "read-back"),
    Source.AGREED: InForce(1.0, Source.AGREED),
}


@pytest.mark.parametrize(
    "turns",
    [
        (Source.UNKNOWN, Source.WRITTEN),
        (Source.UNKNOWN, Source.AGREED),
        (Source.WRITTEN, Source.READ_BACK, Source.UNKNOWN),
        (Source.UNKNOWN, None, Source.WRITTEN, None),
    ],
)
def test_evidence_that_hovers_is_reported_once_for_each_finding(
    turns: tuple[Source | None, ...],
) -> None:
    """In a minute of doubt each finding is reported once, the first at once, and then its end."""
    doubt = AxisDoubt()
    reports, ends = list[str](), 0
    for ms, source in enumerate(islice(cycle(turns), 60_000)):
        if source is None:
            ends += doubt.agrees(ms * MS)
        else:
            reports.append(doubt.found(FOUND[source]))
    over = [doubt.agrees(60 * NS_PER_S + ms * MS) for ms in range(2 * OVER_NS // MS)]

    assert reports[0]
    assert sorted(filter(None, reports)) == sorted(
        {FOUND[source].doubt for source in turns if source} - {""}
    )
    assert (ends, sum(over)) == (0, 1)


def test_doubt_after_the_end_of_another_is_reported_again() -> None:
    """It is one of its own; what is told is always the last finding."""
    doubt = AxisDoubt()
    first = doubt.found(FOUND[Source.UNKNOWN])
    told = doubt.text
    over = [doubt.agrees(0), doubt.agrees(OVER_NS), doubt.agrees(2 * OVER_NS)]
    agreed = doubt.text

    assert (first, told, agreed) == ("unknown", "unknown", "")
    assert over == [False, True, False]
    assert doubt.found(FOUND[Source.UNKNOWN]) == "unknown"
