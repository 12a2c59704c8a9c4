"""What others have for motor records moves an axis: ophyd, ophyd-async, pyepics, motor screens."""

from typing import Final

import pytest

from tests.daemon.daemons import Daemon
from tests.epics.processes import Ioc, peer, run_client

pytestmark = pytest.mark.epics

SCREENS: Final = (
    "ACCL ATHM BACC BDST BVEL CARD CNEN DCOF DESC DHLM DIFF DIR DLLM DLY DMOV DRBV DVAL EGU ERES "
    "FLNK FOFF FRAC HLM HLS HOMF HOMR HVEL ICOF JAR JOGF JOGR JVEL LLM LLS LVIO MIP MOVN MRES MSTA "
    "NTM NTMF OFF PCOF POST PREC PREM RBV RCNT RDBD RDBL REP RLV RMP RRBV RRES RTRY RVAL S SBAK "
    "SBAS SET SMAX SPMG SREV SSET STAT STOP STUP SUSE SYNC TDIR TWF TWR TWV UEIP UREV URIP VAL "
    "VBAS VELO VERS VMAX"
)
"""Fields in the motor screens of synApps for Phoebus: motorx, motorx_all, _more, _setup, _tiny."""


@pytest.fixture
def motor(ioc: Ioc, daemon: Daemon) -> Ioc:
    """Return the IOC, with its stage in RUN."""
    daemon.ask("POST", "stop", {})
    daemon.until("SAFE")
    daemon.ask("DELETE", "lease")
    with peer("aioca", ioc.environ) as client:
        client.until_taken("rig:ARM")
        client.until_taken("rig:x:MODE", 3)
        client.until_taken("rig:x.VELO", 200.0)
    daemon.until("RUN")
    return ioc


def test_epics_motor_of_ophyd(motor: Ioc) -> None:
    """It finds limits and units, moves, refuses what is beyond the limits, stops, and goes on."""
    report = run_client("ophyd", motor.environ, "rig:x")

    assert report["limits"] == [0.0, 26.0]
    assert (report["unit"], report["digits"]) == ("um", 4)
    assert [success for success, _ in report["reached"]] == [True] * 4
    reached = [position for _, position in report["reached"]]
    assert reached == pytest.approx([5.0, 12.5, 12.5, 3.0], abs=0.3)
    assert report["limits refused"] == "LimitError"
    assert report["stopped"] is False
    assert report["moves after stop"] is True


@pytest.mark.parametrize("protocol", ["ca", "pva"])
def test_motor_of_ophyd_async(motor: Ioc, protocol: str) -> None:
    """It connects, moves, and stops; a target beyond its limits fails, over PVA also at the IOC."""
    report = run_client("ophyd_async", motor.environ, "rig:x", protocol)

    assert (report["read"], report["unit"]) == (["x"], "um")
    assert report["reached"] == pytest.approx([5.0, 12.5, 12.5, 3.0], abs=0.3)
    assert report["beyond"] == "MotorLimitsError"
    # Over CA its retry loses the error of aioca, which is false (ophyd-async 0.21.3).
    assert bool(report["forced"]) == (protocol == "pva")
    assert report["stopped"] is False
    assert report["after stop"] == pytest.approx(4.0, abs=0.3)


def test_scan_of_bluesky(motor: Ioc) -> None:
    """A plan of the RunEngine stops at its points."""
    with peer("aioca", motor.environ) as client:
        assert client.put("rig:x.VAL", 1.0) == ""  # `set` refuses to start beyond the limits
    positions = run_client("bluesky", motor.environ, "rig:x")

    assert positions == pytest.approx([2.0, 8.0, 14.0, 20.0], abs=0.3)


def test_motor_of_pyepics(motor: Ioc) -> None:
    """It reads each field that it knows, moves, tweaks, and stops; a forced target fails."""
    report = run_client("pyepics", motor.environ, "rig:x")

    assert report["missing"] == []
    assert report["unread"] == []
    assert report["moves"] == [0, 0, 0]
    assert report["reached"] == pytest.approx(7.6, abs=0.3)
    assert report["raw"] == pytest.approx(report["dial"], abs=1.0)
    assert report["beyond"] == -12
    assert report["forced"] == -4
    assert report["after stop"] == 0
    stopped = report["stop and tweak"]
    assert stopped["target"] == pytest.approx(stopped["position"], abs=0.3)
    assert stopped["after"] == pytest.approx(stopped["target"] + 1.0)
    assert (stopped["tweaked"], stopped["done"]) == (0, [1, 0, 1, 0, 1])


@pytest.mark.parametrize("speed_um_per_s", [200.0, 1.0])
def test_timeout_of_ophyd_async_is_no_shorter_than_a_movement(
    motor: Ioc, daemon: Daemon, speed_um_per_s: float
) -> None:
    """It is the way over VELO and twice ACCL; also clients that add ACCL once wait long enough."""
    with peer("p4p", motor.environ) as client:
        assert client.put("rig:x.VELO", speed_um_per_s) == ""
        acceleration_s = client.value("rig:x.ACCL")
        longest_s = daemon.ask("GET", "config").json()["longest_move_s"]["x"]
        assert client.put("rig:x.VELO", 200.0) == ""
    for part in (0.02, 0.3, 1.0):
        takes_s = longest_s * part * 200.0 / speed_um_per_s
        assert 26.0 * part / speed_um_per_s + acceleration_s >= takes_s


def test_screens_find_each_field(motor: Ioc) -> None:
    """The record has what the screens show; Stop of its stop-and-go switch stops."""
    with peer("caproto", motor.environ) as client:
        for name in SCREENS.split():
            assert client.get(f"rig:x.{name}")["value"] is not None, name
        assert client.get("rig:x_able")["value"] == 0
        assert client.put("rig:x.VAL", 8.0) == ""
        assert client.put("rig:x.SPMG", 0) == ""
        assert client.value("rig:x.SPMG") == 3
        assert client.put("rig:x.VAL", 6.0) == ""
