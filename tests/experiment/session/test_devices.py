"""Devices that a process owns for a time."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from piezod.devices.channels import Channels
from piezod.errors import DeviceError
from piezod.experiment.session.devices import owned


class Counted(Channels):
    """Channels without devices, which note their calls."""

    def __init__(self, broken: str = "") -> None:
        super().__init__({}, {})
        self.calls, self._broken = list[str](), broken

    def __getattribute__(self, name: str) -> object:
        if name in {"open", "activate", "deactivate", "close"}:
            return lambda *_: self._call(name)
        return super().__getattribute__(name)

    def _call(self, name: str) -> None:
        self.calls.append(name)
        if name == self._broken:
            raise DeviceError(f"{name} failed")


@contextmanager
def use(channels: Counted, refusal: str = "") -> Iterator[None]:
    """Use channels, and note that they are closed."""
    done = lambda: channels.calls.append("closed")  # noqa: E731 - shorter than a function
    with owned(channels, lambda: 7, lambda _channels: refusal, done):
        yield


def test_devices_are_left_safe_whatever_ends_the_block() -> None:
    """Their outputs are brought to rest, then they are closed, also after Ctrl-C."""
    channels = Counted()
    with pytest.raises(KeyboardInterrupt), use(channels):
        raise KeyboardInterrupt

    assert channels.calls == ["open", "activate", "deactivate", "close", "closed"]


def test_refused_devices_are_not_activated() -> None:
    """Nothing is driven before the check of what only open devices know; they are closed."""
    channels = Counted()
    with pytest.raises(DeviceError, match="too fast"), use(channels, "too fast"):
        pass

    assert channels.calls == ["open", "close", "closed"]


@pytest.mark.parametrize("broken", ["open", "activate", "deactivate"])
def test_devices_that_fail_are_closed(broken: str) -> None:
    """The error is that of the device, and none stays open."""
    channels = Counted(broken)
    with pytest.raises(DeviceError, match=f"{broken} failed"), use(channels):
        pass

    assert channels.calls[-2:] == ["close", "closed"]
