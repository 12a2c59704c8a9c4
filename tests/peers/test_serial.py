"""Programs by others for serial devices, with our emulated devices: pylablib, nv200."""

import pytest

from tests.drivers.bus.bench import emulated
from tests.peers.peer import need_library, run_peer

pytestmark = pytest.mark.peers


@pytest.mark.confirms(
    "thorlabs_apt",
    "KPZ101",
    part="identity, output voltage, its range and source, enabling",
    by="pylablib KinesisPiezoController",
    kind="client",
)
def test_pylablib_drives_a_kpz101() -> None:
    """The client finds the model, enables the output, and sets and reads a voltage."""
    with emulated("kpz101") as device:
        report = run_peer("pylablib_client.py", "kpz101", device.where[0])

    assert report["model"] == "KPZ101"
    assert report["set"] == pytest.approx([5.0, 12.5], abs=150 / 32_767)
    assert report["enabled"]
    assert report["range"] == 150


@pytest.mark.parametrize("profile", ["mdt693a", "mdt693b", "mdt694b"])
@pytest.mark.confirms(
    "thorlabs_mdt",
    ("mdt693a", "mdt693b", "mdt694b"),
    part="commands of the A models: identity, voltage, range",
    by="pylablib MDT69xA",
    kind="client",
)
def test_pylablib_drives_an_mdt693(profile: str) -> None:
    """The client sets and reads a voltage, and reads the range of voltages."""
    with emulated(profile) as device:
        report = run_peer("pylablib_client.py", "mdt693a", device.where[0])

    assert report["set"] == pytest.approx([5.0, 12.5], abs=0.5)
    assert report["range"] == 150


@pytest.mark.confirms(
    "pi_gcs1",
    "pi-e816",
    part="identity, axes, servo, position",
    by="pylablib PIE516",
    kind="client",
)
def test_pylablib_reads_an_e_816() -> None:
    """The client finds the axes, switches the servo off, and reads the position."""
    with emulated("pi-e816") as device:
        report = run_peer("pylablib_client.py", "e-516", device.where[0])

    assert "E-816" in report["id"]
    assert report["axes"] == ["A"]
    assert report["servo"] is False
    assert report["moved"] == pytest.approx(0.0, abs=1.0)


@pytest.mark.confirms(
    "psj",
    "nv200",
    part="limits, setpoint in V, reading, open loop",
    by="nv200 of piezosystem jena",
    kind="client",
)
def test_nv200_library_drives_an_nv200() -> None:
    """The maker's client reads the limits, sets voltages in open loop, and sees the motion."""
    need_library("nv200")
    with emulated("psj-nv200") as device:
        report = run_peer("nv200_client.py", device.where[0])

    assert report["range"] == [0.0, 150.0]
    assert report["set"] == [20.0, 40.0]
    assert report["moved"][0] < report["moved"][1]
    assert report["closed"] is False
