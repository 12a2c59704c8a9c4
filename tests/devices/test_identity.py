"""Comparison of identities."""

import pytest

from piezod.devices.interface import Identity, is_same

WHO = Identity("maker", "stage µ", "1", "1.0")


@pytest.mark.parametrize(
    ("change", "same"),
    [
        ({"firmware": "2.0"}, True),
        ({"serial": "not told"}, True),
        ({"serial": "unknown"}, True),
        ({"serial": "2"}, False),
        ({"model": "other"}, False),
        ({"maker": "other", "serial": "unknown"}, False),
    ],
)
def test_identities_are_compared(change: dict[str, str], *, same: bool) -> None:
    """Parts that are not reported, and the firmware, do not count."""
    other = WHO._replace(**change)

    assert is_same(WHO, other) is same
    assert is_same(other, WHO) is same
