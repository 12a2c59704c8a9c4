"""Programs by others for serial devices, with our emulated devices: pylablib, nv200, psj-lib."""

import numpy as np
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
    part="commands of the A models: identity, voltage",
    by="pylablib MDT69xA",
    kind="client",
)
def test_pylablib_drives_an_mdt693(profile: str) -> None:
    """The client identifies the amplifier, and sets and reads a voltage."""
    with emulated(profile) as device:
        report = run_peer("pylablib_client.py", "mdt693a", device.where[0])

    assert report["set"] == pytest.approx([5.0, 12.5], abs=0.5)


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
    assert report["moved"][0] + 1.0 < report["moved"][1]
    assert report["closed"] is False


@pytest.mark.confirms(
    "psj",
    "nv200",
    part="waveform generator, data recorder, their commands and replies",
    by="nv200 of piezosystem jena",
    kind="client",
)
def test_nv200_library_plays_a_waveform() -> None:
    """The maker's client writes a waveform in V, plays it, and reads both records."""
    need_library("nv200")
    with emulated("psj-nv200") as device:
        report = run_peer("nv200_waveform_client.py", device.where[0])

    wave = np.array(report["wave"])
    assert report["held"] == pytest.approx(wave[:5], abs=2e-3)
    assert report["loop"] == {"start_index": 0, "loop_start_index": 0, "loop_end_index": 99}
    assert report["running"] is True
    assert report["sources"] == [0, 2]
    voltages, positions = np.array(report["voltages"]), np.array(report["positions"])
    assert voltages.size == positions.size == 100.0 / report["sample_ms"]
    # The client makes the generator the source before it starts, so that the voltage falls to 0 V
    # for a time that nobody knows. Later the amplifier lags a little behind the two cycles.
    t_ms = np.arange(voltages.size) * report["sample_ms"]
    errors_v = voltages - wave[(t_ms / 0.5).astype(int) % wave.size]
    assert np.sqrt(np.mean(errors_v[t_ms > 5.0] ** 2)) < 1.0
    assert np.ptp(positions) > 5.0
    assert report["value"] == pytest.approx(voltages[0])
    # A generator that has ended holds, as emulated; the setpoint is the one before.
    assert report["single"] == pytest.approx(wave[-1], abs=0.1)
    assert report["setpoint"] == 40.0


@pytest.mark.confirms(
    "psj",
    "ddrive",
    part="channels, setpoint in V, reading, status, open loop",
    by="psj-lib of piezosystem jena",
    kind="client",
)
def test_psj_lib_drives_a_d_drive() -> None:
    """The maker's client finds the channel and sets voltages in open loop."""
    need_library("psj_lib")
    with emulated("psj-ddrive") as device:
        report = run_peer("d_drive_client.py", device.where[0])

    assert report["channels"] == [0]
    assert report["closed"] is False
    assert report["moved"] > report["rest"] + 1.0
