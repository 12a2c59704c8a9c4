"""The thread that opens the devices of a stage."""

from typing import Any

import pytest

from piezod.daemon.loop import devices as loop_devices
from piezod.daemon.loop.devices import Opening
from piezod.errors import DeviceUnavailableError
from piezod.testing.fake_clock import FakeClock


class FakeChannels:
    """Implements what is asked of channels here.

    Args:
        absent: How often they cannot be opened.
        wrong: What a driver raises where it is closed.
    """

    def __init__(self, absent: int, wrong: Exception | None = None) -> None:
        self.absent, self.wrong = absent, wrong
        self.done: list[str] = []

    def open(self) -> None:
        self.done.append("open")
        if self.absent:
            self.absent -= 1
            raise DeviceUnavailableError("it is away")

    def activate(self, now_ns: int) -> None:  # noqa: ARG002 - as channels do
        self.done.append("activate")

    def close(self) -> None:
        self.done.append("close")
        if self.wrong:
            raise self.wrong


def opened(channels: Any) -> Opening:
    """Return the thread after it has run; it has waited for nothing."""
    opening = Opening(channels, FakeClock())
    opening.run()
    return opening


@pytest.fixture(autouse=True)
def _no_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_devices, "waits_s", lambda: iter([0.0] * 10))


def test_devices_that_are_absent_are_tried_again() -> None:
    """Each time they are closed before; why the last attempt failed is told."""
    channels = FakeChannels(absent=2)
    opening = opened(channels)

    assert channels.done == ["open", "close", "open", "close", "open", "activate"]
    assert (opening.absent, opening.crash) == ("it is away", None)


def test_a_driver_that_fails_to_close_is_not_taken_for_devices_that_are_open() -> None:
    """What it raised ends the thread, and is told."""
    wrong = OSError("closed by the wrong end")
    opening = opened(FakeChannels(absent=1, wrong=wrong))

    assert opening.crash is wrong
