"""The thread that opens the devices of a stage."""

from typing import Any

import pytest

from piezod.daemon.loop import devices as loop_devices
from piezod.daemon.loop.devices import DeviceOpener
from piezod.devices.interface import Identity
from piezod.errors import DeviceUnavailableError
from piezod.testing.fake_clock import FakeClock


class FakeChannels:
    """Implements the methods of channels that the thread uses."""

    def __init__(self, absent: int, wrong: Exception | None = None) -> None:
        self.absent, self.wrong = absent, wrong
        self.done: list[str] = []
        self.identities: dict[str, Identity] = {}

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


def opened(channels: Any) -> DeviceOpener:
    """Return the thread after it has run."""
    opener = DeviceOpener(channels, FakeClock())
    opener.run()
    return opener


@pytest.fixture(autouse=True)
def _no_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_devices, "waits_s", lambda: iter([0.0] * 10))


def test_devices_that_are_absent_are_tried_again() -> None:
    """The devices are closed before each further attempt; the reason of a failure is kept."""
    channels = FakeChannels(absent=2)
    opener = opened(channels)

    assert channels.done == ["open", "close", "open", "close", "open", "activate"]
    assert (opener.absent, opener.crash) == ("it is away", None)


def test_a_driver_that_fails_to_close_is_not_taken_for_devices_that_are_open() -> None:
    """An exception in closing ends the thread and is kept."""
    wrong = OSError("closed by the wrong end")
    opener = opened(FakeChannels(absent=1, wrong=wrong))

    assert opener.crash is wrong
