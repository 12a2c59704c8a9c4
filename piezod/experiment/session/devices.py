"""Devices that this process owns for a time: in virtual time, or driven by hand."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from piezod.devices.channels import Channels
from piezod.errors import DeviceError


@contextmanager
def owned(
    channels: Channels,
    now_ns: Callable[[], int],
    refusal: Callable[[Channels], str],
    closed: Callable[[], object] = bool,
) -> Iterator[None]:
    """Open devices and make them ready for cycles; whatever ends the block, leave them safe.

    Args:
        channels: The devices, constructed.
        now_ns: Returns the present instant, in ns.
        refusal: Returns why the open devices cannot be used, "" if they can; they are not activated
            then.
        closed: Called when they are closed.

    Raises:
        DeviceError: If a device cannot be opened, or is refused.
    """
    active = False
    try:
        channels.open()
        if why := refusal(channels):
            raise DeviceError(why)
        active = True
        channels.activate(now_ns())
        yield
    finally:
        try:
            if active:
                channels.deactivate(now_ns())
        finally:  # also if Ctrl-C interrupts the deactivation
            channels.close()
            closed()
