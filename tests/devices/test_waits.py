"""Back-off before the next attempt to open a device."""

from itertools import islice

from piezod.devices.waits import FIRST_WAIT_S, LONGEST_WAIT_S, waits_s


def test_each_wait_is_twice_as_long_up_to_the_longest() -> None:
    """The last wait repeats endlessly."""
    assert list(islice(waits_s(0.1, 0.5), 5)) == [0.1, 0.2, 0.4, 0.5, 0.5]
    assert next(waits_s()) == FIRST_WAIT_S
    assert next(islice(waits_s(), 1000, None)) == LONGEST_WAIT_S
