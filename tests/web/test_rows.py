import json

from piezod.messages.documents import Document
from piezod.web.metrics import joined
from piezod.web.rows import RATE_HZ, Decimator, Row, merged, telemetry_event
from tests.client.fake_daemon import interval


def row(t_s: float, position_um: float | None = 1.0, **fields: object) -> Row:
    """Return an interval as a row."""
    return Row("bench", {**interval(position_um, t_s=t_s), "unix_s": t_s, **fields})


def test_rows_become_columns() -> None:
    """Each value is an array with an entry for each row, in the order of the rows."""
    event = json.loads(telemetry_event([row(1.0, 2.5), row(2.0, None, faults=["S5"])]))

    assert (event["event"], event["stage"], event["t_s"]) == ("telemetry", "bench", [1.0, 2.0])
    assert event["faults"] == [[], ["S5"]]
    assert event["axes"]["x"]["position_um"]["last"] == [2.5, None]
    assert event["axes"]["x"]["mode"] == ["adaptive", "adaptive"]


def test_merged_interval_keeps_every_spike() -> None:
    """Minimum and maximum are those of both intervals, counts are added, the rest is the newest."""
    older, newer = row(1.0, 9.0, faults=["S5"]).document, row(2.0, 3.0, faults=["L7"]).document
    newer["late_max_us"] = None

    both = merged(older, newer)

    assert both["axes"]["x"]["position_um"] == {"min": 3.0, "max": 9.0, "last": 3.0}
    assert (both["cycles"], both["t_s"], both["late_max_us"]) == (100, 2.0, 20.0)
    assert both["faults"] == ["S5", "L7"]


def test_merged_interval_of_unknown_values() -> None:
    """An unknown value does not hide a known one; two unknown values stay unknown."""
    unknown = row(2.0, None).document

    assert merged(row(1.0, 4.0).document, unknown)["axes"]["x"]["position_um"] == {
        "min": 4.0,
        "max": 4.0,
        "last": None,
    }
    assert merged(unknown, unknown)["axes"]["x"]["position_um"]["max"] is None


def test_new_axis_appears_in_a_merged_interval() -> None:
    """The axes are those of the newer interval: the configuration may have changed."""
    newer: Document = {**interval(1.0, axis="y")}

    assert merged(row(1.0).document, newer)["axes"].keys() == {"y"}
    assert not row(1.0).fits(Row("bench", newer))


def test_full_rate_passes_every_row_unchanged() -> None:
    """At the rate of the stage each row goes on as it is, so that all tabs share its text."""
    got: list[Row] = []
    pacer = Decimator(RATE_HZ, got.append)
    rows = [row(100 + n / RATE_HZ + (n % 3) * 1e-3) for n in range(90)]

    for each in rows:
        pacer.feed(each)

    assert got == rows


def test_lower_rate_merges_rows() -> None:
    """A lower rate gives fewer rows, and each cycle is in one of them."""
    got: list[Row] = []
    pacer = Decimator(10.0, got.append)

    for n in range(91):
        pacer.feed(row(100 + n / RATE_HZ, float(n)))

    assert len(got) == 31
    assert sum(each.document["cycles"] for each in got) == 91 * 50
    assert got[1].document["axes"]["x"]["position_um"] == {"min": 1.0, "max": 3.0, "last": 3.0}


def test_nothing_is_caught_up_after_a_pause() -> None:
    """Rows after a gap are paced as before."""
    got: list[Row] = []
    pacer = Decimator(10.0, got.append)

    for t_s in (100.0, 200.0, 200.033, 200.067, 200.1):
        pacer.feed(row(t_s))

    assert [each.document["t_s"] for each in got] == [100.0, 200.0, 200.1]


def test_metrics_of_stages_are_joined_by_name() -> None:
    """Each metric has one head, and the samples of all stages below it."""
    one = '# HELP a first\n# TYPE a gauge\na{stage="1"} 1\n# HELP b_total x\nb_total 2\n'
    two = "# HELP b_total x\nb_total 4\n# HELP c third\nc 5\n"

    assert joined([one, two]).splitlines() == [
        "# HELP a first",
        "# TYPE a gauge",
        'a{stage="1"} 1',
        "# HELP b_total x",
        "b_total 2",
        "b_total 4",
        "# HELP c third",
        "c 5",
    ]
