"""The digital lines of the simulated rig."""

import pytest

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

WIRING = Wiring(("x", "line:camera"), ("x", "line:2", "line:1"))
MS = NS_PER_S // 1000


def rig(wiring: Wiring = WIRING) -> SimulatedRig:
    """Return a rig whose camera pulses 100 times a second."""
    options = SimulatedOptions.model_validate({"camera": {"rate_hz": 100.0, "first_s": 0.005}})
    made = SimulatedRig(options, wiring, 1)
    made.open()
    made.activate(0)
    return made


def test_camera_is_high_at_each_pulse() -> None:
    """For a fifth of its interval; the input of the axis is as without lines."""
    made, plain = rig(), rig(Wiring(("x",), ("x",)))
    samples = [made.read(k * MS) for k in range(30)]
    alone = [plain.read(k * MS)[0] for k in range(30)]

    assert [k for k, each in enumerate(samples) if each[1].position_um] == [5, 6, 15, 16, 25, 26]
    assert [each[0] for each in samples] == alone


def test_outputs_are_counted() -> None:
    """They are written with the voltages, or refused with them."""
    made = rig()
    levels = [(0.0, 1.0), (1.0, 1.0), (0.0, 1.0), (1.0, 0.0)]
    taken = [made.write([5.0, *each], k * MS) for k, each in enumerate(levels)]

    assert all(taken)
    assert not made.write([5.0], 9 * MS)
    assert made.pulses_counted()[:3] == (1, 2, 0)
    assert made.read_back(9 * MS)[1:] == [1.0, 0.0]


@pytest.mark.parametrize(
    "wiring", [Wiring(("x", "line:1"), ("x",)), Wiring(("x",), ("x", "line:9"))]
)
def test_unknown_line_is_refused(wiring: Wiring) -> None:
    """The error lists the lines that the rig has."""
    with pytest.raises(DeviceError, match=r"line:1 to line:8, and input line:camera"):
        rig(wiring)


def test_rig_with_lines_plays_no_tables() -> None:
    """Its table would have no columns for them."""
    with pytest.raises(DeviceError, match="lines"):
        rig().player_capabilities()
