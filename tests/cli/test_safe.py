"""`piezod safe` with a rig in another process."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from io import StringIO
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from piezod.cli.devices.guardian import guardian
from piezod.config.daemon import load_daemon
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.lock import Lock, device_lock
from piezod.daemon.noted_identities import note_identities
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import StagePaths, stage_paths
from piezod.devices import registry
from piezod.devices.interface import Identity
from piezod.errors import PiezodError
from piezod_drivers.emulated.driver import EmulatedRig
from piezod_drivers.emulated.options import EmulatedOptions
from tests.cli.conftest import Command
from tests.daemon.locks import is_held
from tests.daemon.supervisor.test_late_imports import SITE
from tests.daemon.waiting import eventually
from tests.forked import Forked, run
from tests.hosted_rig import hosted, writes

STAGE = """
rate_hz: 1000
devices:
  rig: {driver: emulated, options: {socket: SOCKET, deadline_ms: 1000}}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    command_range_um: [0, 26]
    safety: {safe_v: 10, ramp_v_per_s: 200}
"""

if TYPE_CHECKING:
    from piezod.commission.bench import OneAxis

SAFE = ("safe", "stage.yaml")


@pytest.fixture
def paths(folder: Path, monkeypatch: pytest.MonkeyPatch) -> StagePaths:
    """Return the paths of the stage of `stage.yaml`; its folders exist."""
    for variable in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY"):
        monkeypatch.setenv(variable, str(folder / variable.lower()))
    (folder / "stage.yaml").write_text(STAGE.replace("SOCKET", str(folder / "rig.sock")))
    paths = stage_paths(Path("stage.yaml"))
    paths.make_folders()
    return paths


@pytest.fixture
def rig(folder: Path) -> Iterator[EmulatedRig]:
    """Return a closed driver of a rig at 60 V."""
    driver = EmulatedRig(
        EmulatedOptions(socket=str(folder / "rig.sock"), deadline_ms=1000.0), ("x",)
    )
    with hosted(folder / "rig.sock", folder / "trace.csv"):
        driver.open()
        driver.activate(time.monotonic_ns())
        assert driver.write([60.0], time.monotonic_ns())
        eventually(lambda: driver.read_back(time.monotonic_ns())[0] > 59.5)
        driver.close()
        yield driver


def wait_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give a loop process that still lives, and an output that does not follow, no time."""
    monkeypatch.setattr("piezod.daemon.durations.LOOP_ENDS_S", -1.0)
    monkeypatch.setattr("piezod.daemon.durations.OUTPUT_WAIT_S", 0.0)


def in_force_v(driver: EmulatedRig) -> float:
    """Return the read-back voltage of a rig, in V."""
    driver.open()
    (drive_v,) = driver.read_back(time.monotonic_ns())
    driver.close()
    return drive_v


@pytest.mark.usefixtures("paths")
def test_stage_is_ramped_to_its_safe_voltage(
    piezod: Command, folder: Path, rig: EmulatedRig
) -> None:
    """The ramp goes from the read-back voltage in small steps to the safe voltage."""
    code, out, err = piezod("safe", "stage.yaml")
    ramp_v = [write.drive_v for write in writes(folder / "trace.csv")][1:]

    assert (code, err) == (0, "")
    assert out.startswith("x: from 60.")
    assert ramp_v[0] > 57
    assert max(a - b for a, b in pairwise(ramp_v)) <= 2 + 1e-9
    assert in_force_v(rig) == pytest.approx(10, abs=0.5)


@pytest.mark.usefixtures("paths", "rig")
def test_document_has_each_axis(piezod: Command) -> None:
    """With --json there is one document with the result of each axis."""
    code, out, _ = piezod("safe", "stage.yaml", "--json")
    document = json.loads(out)

    assert (code, document["safe"]) == (0, True)
    assert document["axes"]["x"]["from_v"] == pytest.approx(60, abs=0.5)
    assert document["axes"]["x"]["from_noted"] is False


def test_rig_that_has_gone_is_unknown(
    piezod: Command, paths: StagePaths, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a device the last words are the voltage that stays, with exit code 74."""
    wait_for_nothing(monkeypatch)
    LastOutputWriter(paths.output_map, 1).note([60.0], 1)
    code, out, err = piezod("safe", "stage.yaml")

    assert (code, out) == (74, "")
    assert "axis x: the voltage is UNKNOWN: no rig at" in err
    assert "stays at 60.00 V" in err.splitlines()[-1]


def test_another_rig_than_the_daemons_is_left_alone(
    piezod: Command, paths: StagePaths, rig: EmulatedRig
) -> None:
    """Another device than the daemon's is named, not driven, and the exit code is 74."""
    note_identities(paths.identities, {"rig": Identity("piezod", "another rig", "7", "1.0")})
    code, _, err = piezod("safe", "stage.yaml")

    assert code == 74
    assert "UNKNOWN: it is another device: " in err
    assert "expected: piezod another rig 7" in err
    assert in_force_v(rig) > 59.5


@pytest.mark.usefixtures("rig")
def test_living_daemon_is_left_alone(
    piezod: Command, paths: StagePaths, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While a daemon owns the stage the exit code is 75 and nothing is written."""
    monkeypatch.setattr("piezod.cli.daemon.safe.LOCK_WAIT_S", 0.0)
    with Lock(paths.lock):
        code, _, err = piezod("safe", "stage.yaml")

    assert code == 75
    assert f"kill {os.getpid()}" in err
    assert len(writes(folder / "trace.csv")) == 1


@pytest.mark.fault("P2")
def test_loop_that_still_drives_is_waited_for(
    piezod: Command, paths: StagePaths, folder: Path, rig: EmulatedRig
) -> None:
    """The ramp begins only when a loop process without supervisor has ended."""
    loop = device_lock(paths.loop_lock)
    with ThreadPoolExecutor(1) as beside:
        safe = beside.submit(run, SAFE)
        eventually(lambda: is_held(paths.lock))
        untouched = len(writes(folder / "trace.csv"))
        loop.release()

    assert safe.result().returncode == 0
    assert untouched == 1
    assert in_force_v(rig) == pytest.approx(10, abs=0.5)
    assert piezod("safe", "stage.yaml").code == 0


@pytest.mark.usefixtures("paths")
def test_ramp_is_not_left_half_way(folder: Path, rig: EmulatedRig) -> None:
    """SIGTERM, which a service manager sends to children too, does not interrupt the ramp."""
    with Path(os.devnull).open("r+b") as nothing:
        safe = Forked(SAFE, (nothing.fileno(), nothing.fileno(), nothing.fileno()))
        eventually(lambda: len(writes(folder / "trace.csv")) > 1)
        safe.send_signal(signal.SIGTERM)

        assert safe.wait() == 0
    assert in_force_v(rig) == pytest.approx(10, abs=0.5)


@pytest.mark.fault("P2")
@pytest.mark.usefixtures("rig")
def test_loop_that_does_not_end_is_not_joined(
    piezod: Command, paths: StagePaths, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A loop process that does not end is named with exit code 75, and nothing is written."""
    wait_for_nothing(monkeypatch)
    with device_lock(paths.loop_lock):
        code, _, err = piezod("safe", "stage.yaml")

    assert code == 75
    assert f"kill -9 {os.getpid()}" in err
    assert len(writes(folder / "trace.csv")) == 1


def test_clean_end_needs_no_ramp(
    piezod: Command, paths: StagePaths, folder: Path, rig: EmulatedRig
) -> None:
    """With --unless-clean the ramp follows only a daemon that did not end in order."""
    clean = piezod("safe", "stage.yaml", "--unless-clean")
    untouched = len(writes(folder / "trace.csv"))
    paths.running.touch()
    unclean = piezod("safe", "stage.yaml", "--unless-clean")

    assert (clean.code, untouched) == (0, 1)
    assert "nothing to do" in clean.out
    assert unclean.code == 0
    assert in_force_v(rig) == pytest.approx(10, abs=0.5)


@pytest.mark.usefixtures("rig")
def test_broken_file_is_no_hindrance(piezod: Command, paths: StagePaths, folder: Path) -> None:
    """After a crash the copy that the daemon ran is used, and not the present file."""
    copies = [paths.runtime / f"config-{letter}" / "stage.yaml" for letter in "ab"]
    for copy in copies:
        copy.parent.mkdir()
        copy.write_text((folder / "stage.yaml").read_text())
    (folder / "stage.yaml").write_text("rate_hz: [")
    paths.running.touch()

    assert piezod("safe", "stage.yaml").code == 0


@pytest.mark.usefixtures("paths")
def test_half_a_copy_is_not_used(piezod: Command, paths: StagePaths, rig: EmulatedRig) -> None:
    """An incomplete copy is skipped, and the file itself is used."""
    copy = paths.runtime / "config-a" / "stage.yaml"
    copy.parent.mkdir()
    copy.write_text("rate_hz: [")
    paths.running.touch()

    assert piezod("safe", "stage.yaml").code == 0
    assert in_force_v(rig) == pytest.approx(10, abs=0.5)


@pytest.mark.usefixtures("paths", "rig")
def test_nothing_heavy_is_imported() -> None:
    """The ramp imports no numpy, numba, scipy, fastapi and uvicorn, which may be broken."""
    code = """if True:
        import sys
        from piezod.cli import main
        sys.argv = ["piezod", "safe", "stage.yaml"]
        try:
            main.run()
        finally:
            heavy = {"numpy", "numba", "scipy", "fastapi", "uvicorn", "h5py"} & set(sys.modules)
            print(sorted(heavy))
        """
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert ended.stdout.splitlines()[-1] == "[]"


KILLED = """
import os, signal
from pathlib import Path
from types import SimpleNamespace
from piezod.cli.devices.guardian import guardian
from piezod.cli.devices.owned_stage import owning
from piezod.config.daemon import load_daemon
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import stage_paths
from piezod.devices import registry

config = Path("stage.yaml")
with owning(config), guardian(config) as guard:
    guard.watch("x", SimpleNamespace(session=SimpleNamespace(found_v=20.0), identities=IDENTITIES))
    OutputNotes(load_daemon(config, registry), stage_paths(config)).note("x", 60.0)
    Path("closed").touch()  # from now on the guardian imports nothing
    os.kill(os.getpid(), signal.SIGKILL) if KILLED else None
"""


@pytest.mark.parametrize("killed", [True, False])
def test_killed_command_leaves_its_axis_as_it_found_it(
    paths: StagePaths, rig: EmulatedRig, folder: Path, killed: bool
) -> None:
    """The guardian ramps back to the initial voltage; after an orderly end it does nothing."""
    rig.close()
    before = len(writes(folder / "trace.csv"))
    script = KILLED.replace("KILLED", str(killed)).replace("IDENTITIES", "{}")
    site = SITE.format(closed=str(folder / "closed"), imported=str(folder / "imported"))
    (folder / "sitecustomize.py").write_text(site, encoding="ascii")
    command = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(folder)},
    )  # returns when the guardian, which has the same stderr, has ended too

    after = [each.drive_v for each in writes(folder / "trace.csv")[before:]]
    assert command.returncode == (-signal.SIGKILL if killed else 0), command.stderr
    assert not (folder / "imported").exists()
    assert not is_held(paths.lock)
    if killed:
        assert "axis x: ramped from 60." in command.stderr
        assert command.stderr.endswith(" V to 20.00 V\n")
        assert after[-1] == 20.0
        assert after[0] > 57.0
        assert all(a - b <= 2.0 + 1e-9 for a, b in pairwise(after))
    else:
        assert (after, command.stderr) == ([], "")


def test_command_without_a_guardian_that_is_ready_drives_nothing(folder: Path) -> None:
    """It says why: the guardian has died while it loaded, or its configuration cannot be read."""
    opened = cast("OneAxis", SimpleNamespace(session=SimpleNamespace(found_v=20.0), identities={}))
    with (
        pytest.raises(PiezodError, match=r"axis x .*missing\.yaml"),
        guardian(folder / "missing.yaml") as unable,
    ):
        unable.watch("x", opened)
    with (
        pytest.raises(PiezodError, match="has ended"),
        guardian(folder / "missing.yaml") as killed,
    ):
        os.kill(killed._process.pid, signal.SIGKILL)  # noqa: SLF001 - as somebody else may
        killed.watch("x", opened)


def test_safe_knows_what_a_killed_command_wrote_last(
    piezod: Command, paths: StagePaths, rig: EmulatedRig, folder: Path
) -> None:
    """It starts at that voltage, even if the daemon before it wrote another one."""
    text = (folder / "stage.yaml").read_text(encoding="utf-8")
    slow = text.replace("slew_v_per_s: 20000", "slew_v_per_s: 2000")
    (folder / "stage.yaml").write_text(slow, encoding="utf-8")
    rig.close()
    LastOutputWriter(paths.output_map, 1).note([0.0], 1)
    unknown = piezod("safe", "stage.yaml")
    OutputNotes(load_daemon(Path("stage.yaml"), registry), paths).note("x", 60.0)
    known = piezod("safe", "stage.yaml")

    assert (unknown.code, known.code) == (74, 0), known.err
    assert in_force_v(rig) == pytest.approx(10, abs=0.5)


def test_commission_knows_what_was_written_last(
    piezod: Command,
    paths: StagePaths,
    rig: EmulatedRig,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Against that it drives nothing, until a person confirms the read-back."""
    rig.close()
    LastOutputWriter(paths.output_map, 1).note([0.0], 1)
    before = len(writes(folder / "trace.csv"))
    refused = piezod("commission", "stage.yaml", "--yes")
    untouched = len(writes(folder / "trace.csv")) == before
    monkeypatch.setattr("sys.stdin", StringIO("n\n"))
    confirmed = piezod("commission", "stage.yaml", "--confirm-output")
    monkeypatch.setattr("sys.stdin", StringIO("n\n"))
    again = piezod("commission", "stage.yaml")

    assert refused.code == 1
    assert "last write 0 V" in refused.err
    assert "--confirm-output" in refused.err
    assert untouched
    assert (confirmed.code, again.code) == (0, 0), again.err
    assert in_force_v(rig) > 59.0
