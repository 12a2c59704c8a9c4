"""Lines of the loop among the channels of devices."""

from collections.abc import Sequence

from piezod.config.lines import LineConfig
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Sample, Wiring
from piezod.devices.wiring import ChannelPair, wiring_of
from tests.devices.test_channels import FakeBoth

AXES = {"x": ChannelPair("rig", "rig")}
LINES = {
    "shutter": LineConfig(device="io", output="DO1"),
    "exposed": LineConfig(device="io", input="DI0"),
    "gate": LineConfig(device="rig", output="DO0"),
}


class Box(FakeBoth):
    """Notes its writes in a list that several devices share; its inputs show what a test sets."""

    def __init__(self, wiring: Wiring, log: list[list[float]]) -> None:
        super().__init__(wiring.outputs)
        self.wiring, self.log = wiring, log
        self.shows = [Sample(0, 1.0, True)] * len(wiring.inputs)

    def capabilities(self) -> Capabilities:
        return Capabilities(*self.wiring, read_back=len(self.axes) > 1, max_rate_hz=1000.0)

    def read(self, now_ns: int) -> Sequence[Sample]:  # noqa: ARG002 - protocol
        return self.shows

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        self.log.append(list(drive_v))
        return super().write(drive_v, now_ns)


def channels() -> tuple[Channels, dict[str, Box], list[list[float]]]:
    """Return an axis, a device of lines before it in the configuration, and the writes."""
    log: list[list[float]] = []
    devices = {name: Box(wiring_of(name, AXES, LINES), log) for name in ("io", "rig")}
    return Channels(devices, AXES, LINES), devices, log


def test_lines_come_behind_the_channels_of_axes() -> None:
    """So no index of an axis depends on them."""
    assert wiring_of("rig", AXES, LINES) == Wiring(("x",), ("x", "DO0"))
    assert wiring_of("io", AXES, LINES) == Wiring(("DI0",), ("DO1",))


def test_voltages_are_written_before_a_device_of_lines_alone() -> None:
    """Lines of a device that drives an axis are in the same write."""
    made, _, log = channels()
    made.levels.high[:] = [True, False, True]

    assert made.write([7.0], 0)
    made.set_lines(0, at_rest=False)
    assert log == [[7.0, 1.0], [1.0]]
    assert made.read_back(0) == [7.0]


def test_refused_lines_refuse_no_voltage() -> None:
    """The line is unknown until a write of it is taken."""
    made, devices, _ = channels()
    devices["io"].refusing = True
    made.set_lines(0, at_rest=False)
    refused = made.write([7.0], 0), list(made.levels.unknown)
    devices["io"].refusing = False
    made.set_lines(0, at_rest=False)
    taken = made.write([7.0], 0), list(made.levels.unknown)

    assert refused == (True, [True, False, False])
    assert taken == (True, [False, False, False])


def test_high_line_goes_low_at_rest_and_is_left_alone_then() -> None:
    """A refused write is tried again, also where no voltage is written."""
    made, devices, log = channels()
    made.levels.high[:] = [True, False, False]
    made.set_lines(0, at_rest=False)
    made.levels.high[:] = [False, False, False]
    devices["io"].refusing = True
    made.set_lines(1, at_rest=True)
    devices["io"].refusing = False
    for t_ns in range(2, 5):
        made.set_lines(t_ns, at_rest=True)

    assert log == [[1.0], [0.0], [0.0]]


def test_lines_are_low_after_deactivation() -> None:
    """The cut of an emergency stop deactivates all devices in the middle of a pulse."""
    made, _, log = channels()
    made.levels.high[:] = [True, False, False]
    made.set_lines(0, at_rest=False)
    made.deactivate(1)

    assert log == [[1.0], [0.0]]


def test_device_of_lines_says_nothing_of_the_axes() -> None:
    """Whether the stage reads back is a matter of its amplifiers."""
    made, _, _ = channels()

    assert made.capabilities().read_back
    assert made.reads_back() == [True]


def test_level_stays_while_an_input_is_not_valid() -> None:
    """A device behind a worker has no new sample in each cycle."""
    made, devices, _ = channels()
    made.read(0)
    devices["io"].shows = [Sample(0, 0.0, False)]
    made.read(1)
    missing = list(made.levels.high), list(made.levels.unknown)
    devices["io"].shows = [Sample(0, 0.0, True)]
    made.read(2)

    assert missing == ([False, True, False], [False, True, False])
    assert made.levels.high == [False, False, False]
    assert not made.levels.unknown[1]
