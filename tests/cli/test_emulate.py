"""`piezod emulate`: the emulated devices, and its errors."""

import json
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.interface import Identity
from piezod.errors import DeviceUnavailableError
from piezod_drivers.emulated.driver import EmulatedRig
from piezod_drivers.emulated.options import EmulatedOptions
from tests.cli.conftest import Command
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import emulated
from tests.hosted_rig import hosted

STAGE = """
rate_hz: 1000
seed: 7
devices:
  rig: {driver: simulated, options: {variant: afm}}
  other: {driver: simulated}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    command_range_um: [0, 26]
  y:
    amplifier: other
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    command_range_um: [0, 26]
"""


@pytest.fixture
def stage(folder: Path) -> str:
    """Return the name of a configuration with two rigs."""
    (folder / "stage.yaml").write_text(STAGE)
    return "stage.yaml"


@contextmanager
def ended_by(number: signal.Signals, driver: EmulatedRig) -> Iterator[list[Identity]]:
    """Let a thread open a driver as soon as this process serves a rig, then end the process.

    Yields:
        The identity of the rig, available at the end.
    """
    found: list[Identity] = []

    def open_it() -> bool:
        with suppress(DeviceUnavailableError):
            found.append(driver.open())
        return bool(found)

    def run() -> None:
        try:
            eventually(open_it)
            driver.close()
        finally:
            os.kill(os.getpid(), number)

    thread = threading.Thread(target=run)
    thread.start()
    yield found
    thread.join()


def test_rig_is_that_of_a_configuration(piezod: Command, folder: Path, stage: str) -> None:
    """Options, axes and seed are those of the device; --json has its place."""
    path = folder / "rig.sock"
    arguments = ["--config", stage, "--device", "rig", "--socket", path, "--json"]
    driver = EmulatedRig(EmulatedOptions(socket=str(path)), ("x", "y"))
    with ended_by(signal.SIGINT, driver) as found:
        code, out, _ = piezod("emulate", "simulated", *arguments)

    assert code == 0
    serving = [{"profile": "simulated", "where": str(path)}]
    assert json.loads(out) == {"serving": serving, "axes": ["x", "y"]}
    assert (found[0].model, found[0].serial) == ("simulated afm", "seed 7")
    assert not path.exists()


def test_rig_is_where_drivers_look_by_default(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without --socket the rig is at the default socket of its driver, in a new folder."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    with ended_by(signal.SIGTERM, EmulatedRig(EmulatedOptions(), ("x",))) as found:
        code, out, _ = piezod("emulate", "simulated")

    assert code == 0
    assert str(folder / "piezod" / "rig.sock") in out
    assert found[0].serial == "seed 1"


def test_folder_of_another_user_is_not_used(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of another user is refused, because another rig could be there."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setattr("os.getuid", lambda: 4_000_000)
    code, _, err = piezod("emulate", "simulated")

    assert code == 69
    assert "belongs to another user" in err


def test_second_rig_at_a_socket_is_refused(piezod: Command, folder: Path) -> None:
    """A socket that is in use is refused with exit code 69."""
    path = folder / "rig.sock"
    with hosted(path, folder / "trace.csv"):
        code, _, err = piezod("emulate", "simulated", "--socket", path)

    assert code == 69
    assert "another rig is hosted at" in err


def test_socket_that_cannot_be_made(piezod: Command, folder: Path) -> None:
    """A socket that cannot be made exits with 69, and the error names it."""
    code, _, err = piezod("emulate", "simulated", "--socket", folder / "none" / "rig.sock")

    assert code == 69
    assert "cannot create a socket at" in err


def test_device_has_to_be_named_among_several(piezod: Command, stage: str) -> None:
    """Without --device, the error lists the rigs of the file."""
    code, _, err = piezod("emulate", "simulated", "--config", stage)

    assert code == 2
    assert "rig, other" in err


def test_profile_that_nothing_emulates(piezod: Command) -> None:
    """An unknown profile is refused, and the error lists the known ones."""
    code, _, err = piezod("emulate", "acme")

    assert code == 1
    assert "unknown emulator 'acme', known emulators: " in err


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("simulated", "other", "--port", "x.tty"), "PROFILE=WHERE for each"),
        (("simulated=a.sock", "--port", "b.sock"), "is for a single PROFILE"),
        (("pi-e816", "--fault", "slow"), "unknown fault 'slow'"),
        (("simulated", "--fault", "lost"), "has no wire"),
        (("pi-e816", "--fault", "bus-off:now"), "bus-off:now needs a CAN bus"),
        (("canopen-401", "pi-e816", "--fault", "foreign"), "foreign needs a CAN bus"),
        (("simulated", "--config", "stage.yaml", "--device", "rig", "--axes", "3"), "has 2"),
        (("simulated", "--axes", "0"), "--axes"),
    ],
)
def test_profile_without_emulator_is_refused(
    piezod: Command, stage: str, arguments: tuple[str, ...], what: str
) -> None:
    """A mistake on the command line exits with 2 and names the remedy."""
    assert stage
    code, _, err = piezod("emulate", *arguments)

    assert code == 2
    assert what in " ".join(err.split())


def test_several_devices_share_a_stage() -> None:
    """Two devices share one stage; an invalid line on stdin changes no fault."""
    with emulated("pi-e816", "pi-gcs2") as devices:
        one, other = (SerialLine(where, 115_200) for where in devices.where)
        one.open()
        other.open()
        one.send(b"SVA A50.0\n")

        def voltage() -> float:
            other.send(b"VOL? 1\n")
            return float(other.receive(10_000_000_000).decode().strip().partition("=")[2])

        eventually(lambda: voltage() > 49)
        devices.faults("lost")
        devices.faults()
        devices.process.stdin.write("nonsense\n")
        devices.process.stdin.flush()
        assert "unchanged, unknown fault 'nonsense'" in devices.process.stdout.readline()
        one.close()
        other.close()
