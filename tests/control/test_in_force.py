"""Tests of the judge of the voltage in force."""

from math import isnan, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.control.in_force import (
    OUTPUT_WAIT_S,
    Claim,
    Evidence,
    InForce,
    Source,
    left_alone,
    voltage_in_force,
)

TOLERANCE_V = 0.75
voltages = st.floats(-10.0, 160.0)
positions = st.floats(-5.0, 35.0) | st.just(nan)


@st.composite
def claims(draw: st.DrawFn, *, none: bool = False) -> Claim:
    """Return a voltage with the positions that a model may allow there, or with none."""
    drive_v = draw(voltages | st.just(nan)) if none else draw(voltages)
    if isnan(drive_v) or draw(st.booleans()):
        return Claim(drive_v)
    low_um = draw(st.floats(-5.0, 30.0))
    return Claim(drive_v, low_um, low_um + draw(st.floats(0.0, 10.0)))


@given(
    read_back=claims(none=True),
    written=claims(none=True),
    position_um=positions,
    moved=st.sampled_from([nan, 0.0, 0.3, 1.0]),
    explained=st.booleans(),
    reported=st.booleans(),
)
@settings(max_examples=300)
def test_voltage_in_force_is_credible(
    read_back: Claim,
    written: Claim,
    position_um: float,
    moved: float,
    explained: bool,
    reported: bool,
) -> None:
    """It is one of the two or unknown, and doubt is reported.

    It is the read-back if the amplifier reports that its output changed, and otherwise never the
    voltage that the sensor alone excludes. It is unknown where nothing decides.
    """
    known = Evidence(read_back, written, position_um, moved, reported, explained)
    found = voltage_in_force(known, TOLERANCE_V)
    claimed = [claim for claim in (read_back, written) if claim.drive_v == found.drive_v]
    two = abs(read_back.drive_v - written.drive_v) > TOLERANCE_V

    assert bool(claimed) == (found.source is not Source.UNKNOWN)
    if two and not claimed:
        assert not (explained or reported or found.proven)
    elif two and reported:
        assert found.drive_v == read_back.drive_v
    elif two and isnan(moved) and not explained:
        other = written if claimed[0] is read_back else read_back
        assert other.excludes(position_um) or not claimed[0].excludes(position_um)
    if claimed:
        assert bool(found.doubt) == (two or claimed[0].excludes(position_um))


AT_0, AT_60, AT_100 = Claim(0.0, -3.0, 3.0), Claim(60.0, 7.0, 17.0), Claim(100.0, 16.0, 26.0)


@pytest.mark.parametrize(
    ("known", "drive_v", "source", "proven"),
    [
        (Evidence(AT_60, AT_60, 12.0), 60.0, Source.AGREED, True),
        (Evidence(AT_60, Claim(60.75)), 60.0, Source.AGREED, True),
        (Evidence(AT_60, Claim(60.76)), nan, Source.UNKNOWN, False),
        (Evidence(Claim(60.76), AT_60), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, Claim(nan), 12.0), 60.0, Source.AGREED, True),
        (Evidence(Claim(nan), AT_60, 12.0), 60.0, Source.AGREED, True),
        (Evidence(Claim(nan), Claim(nan)), nan, Source.UNKNOWN, True),
        (Evidence(AT_60, AT_60, 2.0), 60.0, Source.AGREED, False),
        (Evidence(AT_60, AT_60, 7.0), 60.0, Source.AGREED, True),
        (Evidence(AT_60, AT_60, 17.0), 60.0, Source.AGREED, True),
        (Evidence(Claim(nan), AT_60, 18.0), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, Claim(nan), 18.0), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, Claim(nan), 16.0), 60.0, Source.AGREED, True),
        (Evidence(AT_60, AT_100), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, AT_100, 16.5), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, AT_100, 40.0), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, AT_100, 20.0), 100.0, Source.WRITTEN, False),
        (Evidence(AT_60, AT_100, 10.0), 60.0, Source.READ_BACK, True),
        (Evidence(AT_60, AT_100, nan, 0.24), 100.0, Source.WRITTEN, False),
        (Evidence(AT_60, AT_100, nan, 0.25), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, AT_100, nan, 0.33), nan, Source.UNKNOWN, False),
        (Evidence(AT_60, AT_100, nan, 0.34), 60.0, Source.READ_BACK, True),
        (Evidence(AT_60, AT_100, 20.0, 1.0), nan, Source.UNKNOWN, False),
        (Evidence(AT_0, AT_100, 20.0, 1.0, explained=True), 0.0, Source.READ_BACK, False),
        (Evidence(AT_0, AT_100, explained=True), 0.0, Source.READ_BACK, False),
        (Evidence(AT_0, AT_100, 20.0, explained=True), 100.0, Source.WRITTEN, False),
        (Evidence(AT_60, AT_100, 12.0, 0.0, reports_move=True), 60.0, Source.READ_BACK, True),
        (Evidence(AT_60, AT_100, 20.0, 1.0, reports_move=True), 60.0, Source.READ_BACK, False),
    ],
)
def test_witnesses_decide_in_their_order(
    known: Evidence, drive_v: float, source: Source, proven: bool
) -> None:
    """The amplifier's report, then the sensor, then a loss of power; otherwise nothing does."""
    found = voltage_in_force(known, TOLERANCE_V)

    assert (found.source, found.proven) == (source, proven)
    assert found.drive_v == drive_v or (isnan(found.drive_v) and isnan(drive_v))


@pytest.mark.parametrize(
    ("read_back_v", "rest_v", "watchdog", "explained"),
    [
        (0.75, 30.0, False, True),
        (30.7, 30.0, False, True),
        (60.0, 30.0, False, False),
        (120.0, 30.0, True, False),
        (99.0, 30.0, True, True),
        (10.0, 30.0, True, True),
        (-40.0, 30.0, True, False),
        (-41.0, 30.0, True, False),
    ],
)
def test_output_alone_goes_to_rest_or_loses_its_power(
    read_back_v: float, rest_v: float, watchdog: bool, explained: bool
) -> None:
    """Anything else has no cause, and is a false read-back or somebody else's write."""
    assert left_alone(read_back_v, 100.0, rest_v, TOLERANCE_V, watchdog=watchdog) is explained


@given(true_v=st.floats(20.0, 140.0), share=st.floats(0.0, 0.9), sensed=st.booleans())
def test_false_read_back_of_a_fall_makes_no_step(true_v: float, share: float, sensed: bool) -> None:
    """A ramp begins where the sensor shows the output; without a sensor nothing is written."""
    truth, wrong = (
        Claim(drive_v, drive_v - 15.0, drive_v + 15.0) for drive_v in (true_v, share * true_v)
    )
    known = Evidence(wrong, truth, true_v if sensed else nan)
    start_v = voltage_in_force(known, TOLERANCE_V).drive_v

    assert isnan(start_v) or abs(start_v - true_v) <= TOLERANCE_V
    assert sensed or isnan(start_v)


@pytest.mark.parametrize(
    ("known", "doubt"),
    [
        (Evidence(AT_60, AT_60, 12.0), ""),
        (
            Evidence(AT_60, AT_60, 2.0),
            "read-back 60 V (allows 7 to 17 µm), last write 60 V (allows 7 to 17 µm) and sensor "
            "2 µm do not agree: there is no other voltage to start from",
        ),
        (
            Evidence(Claim(60.0), Claim(100.0)),
            "read-back 60 V, last write 100 V and no sensor to ask do not agree: nothing tells "
            "which of them is right",
        ),
        (
            Evidence(Claim(0.0), Claim(100.0), explained=True),
            "read-back 0 V, last write 100 V and no sensor to ask do not agree: the read-back "
            "counts, because the output may have come there by itself",
        ),
        (
            Evidence(Claim(60.0), Claim(100.0), reports_move=True),
            "read-back 60 V, last write 100 V and no sensor to ask do not agree: the read-back "
            "counts, because the amplifier reports that its output has changed",
        ),
        (
            Evidence(Claim(60.0), AT_100, 10.0),
            "read-back 60 V, last write 100 V (allows 16 to 26 µm) and sensor 10 µm do not agree: "
            "the sensor allows 60 V only",
        ),
        (
            Evidence(AT_60, Claim(100.0), 20.0),
            "read-back 60 V (allows 7 to 17 µm), last write 100 V and sensor 20 µm do not agree: "
            "the sensor allows 100 V only",
        ),
        (
            Evidence(Claim(nan), AT_60, 18.0),
            "read-back unknown, last write 60 V (allows 7 to 17 µm) and sensor 18 µm do not agree: "
            "nothing tells which of them is right",
        ),
        (
            Evidence(AT_60, Claim(nan), 18.0),
            "read-back 60 V (allows 7 to 17 µm) and sensor 18 µm do not agree: nothing tells which "
            "of them is right",
        ),
    ],
)
def test_doubt_names_the_numbers(known: Evidence, doubt: str) -> None:
    """A person who has to decide sees every witness, and what follows."""
    assert voltage_in_force(known, TOLERANCE_V).doubt == doubt


def test_agreement_is_the_usual_case() -> None:
    """Without a word, a voltage is proven, and nothing doubts it."""
    assert InForce(1.0, Source.AGREED) == InForce(1.0, Source.AGREED, "", proven=True)


def test_loop_and_rescue_wait_within_the_time_of_systemd() -> None:
    """Two waits, and two ramps over 150 V at 50 V/s, end before a service is killed."""
    assert 10.0 <= OUTPUT_WAIT_S <= (90.0 - 2 * 3.0 - 10.0) / 2.0
