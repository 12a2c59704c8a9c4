"""A measurement that was late is repeated, and says so if it stays late."""

from collections.abc import Iterable

import pytest

from piezod.errors import DataError, DeviceError, LatenessError
from piezod.experiment.lateness import ATTEMPTS, Lateness, until_punctual

PUNCTUAL = Lateness(1000, 2, 0, 1)
BUSY = Lateness(1000, 300)
SLOW_DEVICES = Lateness(1000, 0, 300)
UNANSWERED = Lateness(1000, 20, 0, 30)


def measured(outcomes: Iterable[tuple[Lateness, BaseException | None]], prepared: list[str]) -> int:
    """Measure with these outcomes, one after the other; return the number of the used one."""
    number, coming, now = 0, iter(outcomes), PUNCTUAL

    def measure() -> int:
        nonlocal number, now
        number += 1
        now, error = next(coming)
        if error is not None:
            raise error
        return number

    return until_punctual(measure, lambda: now, prepared.append, DeviceError, DataError)


def test_punctual_result_is_taken() -> None:
    """Nothing is repeated."""
    prepared = list[str]()

    assert measured([(PUNCTUAL, None)], prepared) == 1
    assert prepared == []


@pytest.mark.parametrize("late", [BUSY, UNANSWERED])
@pytest.mark.parametrize("error", [None, DeviceError("the sensor is at its end")])
def test_late_attempt_is_repeated(late: Lateness, error: Exception | None) -> None:
    """Neither its result nor its error counts."""
    prepared = list[str]()

    assert measured([(late, error), (PUNCTUAL, None)], prepared) == 2
    assert "the computer was late" in prepared[0]


def test_punctual_failure_is_that_of_the_stage() -> None:
    """This holds also after a late attempt."""
    end = DeviceError("the sensor is at its end")

    with pytest.raises(DeviceError, match="at its end"):
        measured([(PUNCTUAL, end)], [])
    with pytest.raises(DeviceError, match="at its end"):
        measured([(BUSY, None), (PUNCTUAL, end)], [])


@pytest.mark.parametrize("error", [None, DeviceError("the sensor is at its end")])
def test_measurement_that_stays_late_says_so(error: Exception | None) -> None:
    """The text has the late cycles of all attempts."""
    with pytest.raises(LatenessError, match=r"^the computer was late: 900 of 3000 cycles"):
        measured([(BUSY, error)] * ATTEMPTS, [])


def test_slow_devices_spoil_no_result_and_are_not_called_the_computer() -> None:
    """Cycles that overran excuse a failure only."""
    assert measured([(SLOW_DEVICES, None)], []) == 1
    with pytest.raises(LatenessError, match=r"^the devices were late: 900 of 3000 cycles"):
        measured([(SLOW_DEVICES, DeviceError("no sample"))] * ATTEMPTS, [])


def test_stage_that_cannot_be_prepared_again_names_the_lateness() -> None:
    """A latched fault may be its consequence."""

    def refuse(_reason: str) -> None:
        raise DeviceError("a latched fault")

    with pytest.raises(LatenessError, match=r"^the computer was late.*; a latched fault$"):
        until_punctual(lambda: 0, lambda: BUSY, refuse, DeviceError)


def test_other_errors_are_not_caught() -> None:
    """An interruption ends the measurement."""
    with pytest.raises(KeyboardInterrupt):
        measured([(BUSY, KeyboardInterrupt())], [])
