"""What a command that drives a stage leaves for the next process."""

from collections.abc import Mapping
from math import isnan, nan
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.daemon.last_output import LastOutputReader, LastOutputWriter
from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import StagePaths
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Identity

SIMULATED = Path(__file__).parents[2] / "config" / "simulated.yaml"
ONE, OTHER = Identity("maker", "model", "7", "1.0"), Identity("maker", "model", "8", "1.0")
NEWER = ONE._replace(firmware="2.0")


@pytest.fixture
def paths(tmp_path: Path) -> StagePaths:
    """Return the paths of a stage."""
    return StagePaths("stage", tmp_path, tmp_path)


def two_axes() -> DaemonConfig:
    """Return a stage with an amplifier for each of two axes."""
    config = load_daemon(SIMULATED, registry)
    x = config.axes["x"]
    second = x.amplifier.model_copy(update={"device": "other"})
    axes = {"x": x, "y": x.model_copy(update={"amplifier": second})}
    return config.model_copy(update={"axes": axes})


def opened(identities: Mapping[str, Identity], **able: bool) -> Channels:
    """Return open devices with these identities and capabilities."""
    has = Capabilities((), (), True, 1e3, **({"holds": True} | able))  # type: ignore[arg-type] # none is a sequence
    devices = {name: SimpleNamespace(capabilities=lambda: has) for name in identities}
    return cast("Channels", SimpleNamespace(identities=dict(identities), devices=devices))


def stored_v(paths: StagePaths) -> list[float]:
    """Return the stored voltages."""
    return [each.drive_v for each in LastOutputReader(paths.output_map).read()]


def test_what_the_loop_wrote_is_known_and_kept(paths: StagePaths) -> None:
    """A command learns it, and changes that of its own axis only."""
    LastOutputWriter(paths.output_map, 2).note([40.0, 50.0], 1)
    notes = OutputNotes(two_axes(), paths)
    before_v = notes.last_v("x"), notes.last_v("y")
    notes.note("y", 60.0)

    assert before_v == (40.0, 50.0)
    assert stored_v(paths) == [40.0, 60.0]


@pytest.mark.parametrize(
    ("found", "relaxed", "left_v"),
    [
        (ONE, False, 40.0),
        (NEWER, False, 40.0),
        (OTHER, False, nan),
        (ONE, True, nan),
    ],
)
def test_voltage_of_another_amplifier_is_forgotten(
    paths: StagePaths, found: Identity, relaxed: bool, left_v: float
) -> None:
    """It says nothing about this one, nor about one that begins at rest; other axes keep theirs."""
    LastOutputWriter(paths.output_map, 2).note([40.0, 50.0], 1)
    note_identities(paths.identities, {"rig": ONE, "other": ONE})
    OutputNotes(two_axes(), paths).meet(opened({"rig": found}, opens_relaxed=relaxed))
    x_v, y_v = stored_v(paths)

    assert (x_v == left_v or (isnan(left_v) and isnan(x_v))) and y_v == 50.0
    assert noted_identities(paths.identities) == {"rig": found, "other": ONE}


@pytest.mark.parametrize("clean", [True, False])
@pytest.mark.parametrize("able", [{"holds": False}, {"watchdog": True}, {}])
def test_output_that_goes_to_rest_by_itself_is_forgotten_after_an_end_in_order(
    paths: StagePaths, able: dict[str, bool], *, clean: bool
) -> None:
    """After a crash its last write counts; one that holds its output keeps it anyway."""
    LastOutputWriter(paths.output_map, 2).note([40.0, 50.0], 1)
    if not clean:
        paths.running.touch()
    notes = OutputNotes(two_axes(), paths)
    notes.meet(opened({"rig": ONE}, **able))

    assert isnan(notes.last_v("x")) is (clean and bool(able))
    assert notes.last_v("y") == 50.0


@pytest.mark.parametrize("able", [{"holds": False}, {"watchdog": True}, {}])
def test_closed_device_that_goes_to_rest_is_forgotten(
    paths: StagePaths, able: dict[str, bool]
) -> None:
    """A refused takeover has noted nothing, so that its doubt stays."""
    paths.running.touch()
    LastOutputWriter(paths.output_map, 2).note([40.0, 50.0], 1)
    notes = OutputNotes(two_axes(), paths)
    notes.meet(opened({"rig": ONE, "other": ONE}, **able))
    notes.note("y", 30.0)
    notes.leave()

    assert notes.last_v("x") == 40.0
    assert isnan(stored_v(paths)[1]) is bool(able)
