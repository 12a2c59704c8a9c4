"""The clock of a rig waits for a device that plays."""

from piezod.devices.emulation.rig_clock import RigClock


def test_time_waits_and_goes_on_without_a_jump() -> None:
    """At a limit the clock stops; when it goes on, the time in between is lost."""
    real = [1000]
    clock = RigClock(lambda: real[0])
    clock.wait_at(1500)
    found = []
    for real[0] in (1400, 1900, 2500):
        found.append(clock())
    clock.wait_at(1700)
    for real[0] in (2600, 2900):
        found.append(clock())
    clock.wait_at(None)
    real[0] = 5000
    found.append(clock())
    assert found == [1400, 1500, 1500, 1600, 1700, 3800]
