"""Digital lines of a converter card, over a library that has a parallel port."""

import os
from collections.abc import Iterator
from typing import Any, Final

import pytest

from piezod.errors import DeviceError
from piezod_drivers.kernel.comedi import library as names
from piezod_drivers.kernel.comedi.card import Pin
from piezod_drivers.kernel.comedi.comedi_card import ComediCard

KINDS: Final = (names.INPUTS, names.DIGITAL_BOTH, names.DIGITAL_INPUTS, names.DIGITAL_OUTPUTS)
COUNTS: Final = (16, 8, 5, 4)


class ParallelPort:
    """What the card asks libcomedi; the lines of subdevice 1 have one direction."""

    def __init__(self, fd: int) -> None:
        self._fd, self.driven = fd, 0
        self.configured = list[tuple[int, int]]()

    def __getattr__(self, name: str) -> Any:
        known = {"get_driver_name": b"parport", "get_board_name": b"parport", "open": 1}
        return lambda *_: known.get(name.removeprefix("comedi_"), 0)

    def comedi_fileno(self, _device: int) -> int:
        return self._fd

    def comedi_get_n_subdevices(self, _device: int) -> int:
        return len(KINDS)

    def comedi_get_subdevice_type(self, _device: int, subdevice: int) -> int:
        return KINDS[subdevice] if subdevice < len(KINDS) else -1

    def comedi_get_n_channels(self, _device: int, subdevice: int) -> int:
        return COUNTS[subdevice]

    def comedi_dio_config(self, _device: int, subdevice: int, _number: int, driven: int) -> int:
        assert KINDS[subdevice] == names.DIGITAL_BOTH
        self.driven = driven
        self.configured.append((subdevice, driven))
        return 1

    def comedi_dio_get_config(self, _device: int, _subdevice: int, _number: int, found: Any) -> int:
        found.value = self.driven
        return 0


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[ParallelPort]:
    """Make the port what libcomedi opens."""
    fd, other = os.pipe()
    port = ParallelPort(fd)
    monkeypatch.setattr(names, "libcomedi", lambda: port)
    yield port
    os.close(fd)
    os.close(other)


@pytest.fixture
def card(port: ParallelPort) -> ComediCard:  # noqa: ARG001 - it is what is opened
    """Return the open card."""
    card = ComediCard("/dev/comedi0")
    card.open()
    return card


@pytest.mark.parametrize(
    ("number", "subdevice", "driven", "found"),
    [(0, None, True, 1), (7, None, False, 1), (4, 2, False, 2), (3, 3, True, 3)],
)
def test_line_is_on_the_first_subdevice_that_can(
    number: int, subdevice: int | None, driven: bool, found: int, card: ComediCard
) -> None:
    """Or on the one that is named."""
    assert card.line(number, subdevice, driven=driven) == Pin(found, number, 0, 0)


@pytest.mark.parametrize(
    ("number", "subdevice", "driven"),
    [(8, None, True), (8, None, False), (5, 2, False), (0, 2, True), (0, 0, False), (0, 9, True)],
)
def test_line_that_is_missing_is_refused(
    number: int, subdevice: int | None, driven: bool, card: ComediCard
) -> None:
    """Also one of a subdevice that has no such lines."""
    with pytest.raises(DeviceError, match=f"{number}.*allowed"):
        card.line(number, subdevice, driven=driven)


def test_line_that_has_its_direction_stays_as_it_is(port: ParallelPort, card: ComediCard) -> None:
    """Only what differs is configured, and never a line that cannot be both."""
    both, fixed = Pin(1, 0, 0, 0), (Pin(3, 0, 0, 0), Pin(2, 0, 0, 0))
    for _ in range(2):
        card.direct([both, fixed[0]], [fixed[1]])
    assert port.configured == [(1, 1)]


def test_lines_of_a_group_have_one_direction(port: ParallelPort, card: ComediCard) -> None:
    """An output beside an input of its group is refused, and drives nothing then."""
    with pytest.raises(DeviceError, match="one direction"):
        card.direct([Pin(1, 0, 0, 0)], [Pin(1, 1, 0, 0)])
    assert not port.driven
