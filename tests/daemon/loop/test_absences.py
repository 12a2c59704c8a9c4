"""Why lost devices cannot be opened again."""

import pytest

from piezod.config.faults import Fault
from piezod.daemon.loop.absences import Absences
from piezod.devices.reconnecting import ReconnectingDevice
from piezod.devices.status import DeviceFlag
from tests.devices.fake_link import WHO, FakeLink


@pytest.mark.fault("B14")
def test_each_reason_is_told_once() -> None:
    """A reason is told again after the device was connected."""
    link = FakeLink()
    link.open()
    device = ReconnectingDevice(link, WHO)
    absences = Absences({"amp": device})
    told: list[list[tuple[str, str]]] = []
    for absent, obstacle in (
        ("", None),
        ("it is away", None),
        ("it is away", None),
        ("it is held", DeviceFlag.PORT_SHARED),
        ("", None),
        ("it is held", DeviceFlag.PORT_SHARED),
    ):
        device.absent, device.obstacle = absent, obstacle
        told.append([(each.text, each.fault) for each in absences.take_events(7)])

    held = [("amp: it is held", Fault.B14)]
    assert told == [[], [("amp: it is away", Fault.B1)], [], held, [], held]
