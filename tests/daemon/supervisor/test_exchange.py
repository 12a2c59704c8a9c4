"""The exchange of a loop for one with another configuration, with loops without devices."""

import asyncio
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from piezod.control.faults.table import FAULTS, mask
from piezod.daemon import accepted_config
from piezod.daemon.loop import accept
from piezod.daemon.paths import StagePaths
from piezod.daemon.stage.errors import BadValueError, NotNowError
from piezod.daemon.supervisor import loop_run, processes
from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.daemon.supervisor.reload import changes, exchange, kept_axes, prepare
from piezod.daemon.supervisor.source_files import SourceFiles
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from piezod.telemetry.succession import Succession, put_succession, succession_of
from tests.daemon.daemons import REPOSITORY, configuration
from tests.daemon.fake_loop import start_fake_loop
from tests.daemon.fake_rescuer import FakeRescuer


@pytest.fixture(autouse=True)
def _fake_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    def started(_module: str, *arguments: str) -> Any:
        return start_fake_loop(*arguments)

    def rescuer(*_arguments: Any) -> FakeRescuer:
        return FakeRescuer()

    monkeypatch.setattr(processes, "start", started)
    monkeypatch.setattr(loop_run, "Rescuer", rescuer)


class Exchanged:
    """The result of a reload."""

    def __init__(self, folder: Path, source: Path, text: str) -> None:
        self.runs: list[LoopRun] = []
        self._source, self._text = source, text
        self._paths = StagePaths("rig", folder / "runtime", folder / "state")
        self._paths.make_folders()
        self.came_up = asyncio.run(self._exchange())

    async def _exchange(self) -> bool:
        self.runs.append(LoopRun(self._paths, self._source, "config-a"))
        self.runs[0].accept()
        self.runs[0].start()
        watching = asyncio.create_task(self._watch())
        try:
            while not self.runs[0].loop.health.started:
                await asyncio.sleep(0.01)
            self._source.write_text(self._text, encoding="utf-8")
            fresh = await prepare(self.runs[0], self._paths, self._source)
            came_up = await exchange(self.runs[0], self._paths, fresh, self.runs.append)
            self.code_of_first = self.runs[0].exit_code
            self.title = self.runs[-1].loop.config.title
            self.kept = json.loads(self.runs[-1].config_file.read_text(encoding="utf-8"))
            while self.runs[-1].exit_code is None and self.runs[-1].request_end():
                await asyncio.sleep(0.01)
        finally:
            watching.cancel()
            for run in self.runs:
                run.kill()
        return came_up

    async def _watch(self) -> None:
        while True:
            self.runs[-1].loop.health.update(0)
            await asyncio.sleep(0.005)


def titled(path: Path, title: str) -> str:
    """Return the text of a configuration with another title."""
    return re.sub("(?m)^title: .*", f"title: {title}", path.read_text(encoding="utf-8"))


@pytest.fixture
def old_file(rig_file: Path) -> Path:
    """Return the configuration of a simulated stage with the title "old"."""
    rig_file.write_text(titled(rig_file, "old"), encoding="utf-8")
    return rig_file


def test_new_configuration_is_in_force(tmp_path: Path, old_file: Path) -> None:
    """The old loop ends in order, and the new one runs the accepted configuration."""
    exchanged = Exchanged(tmp_path, old_file, titled(old_file, "new"))

    assert exchanged.came_up
    assert exchanged.code_of_first == 0
    assert exchanged.title == exchanged.kept["title"] == "new"


@pytest.mark.fault("P11")
def test_configuration_whose_loop_fails_is_taken_back(tmp_path: Path, old_file: Path) -> None:
    """A loop with the old configuration runs again, from its own copy; the file still differs."""
    exchanged = Exchanged(tmp_path, old_file, titled(old_file, "broken"))

    assert not exchanged.came_up
    assert [run.config.title for run in exchanged.runs] == ["old", "broken", "old"]
    assert exchanged.code_of_first == 0
    assert exchanged.title == exchanged.kept["title"] == "old"
    assert exchanged.runs[-1].source_files.changed()


class Accepted:
    """The running loop, as far as `prepare` uses it."""

    def __init__(self, source: Path) -> None:
        self.config = accept.load(source)
        self.config_file = Path("runtime/config-a/rig.yaml")


def prepared(folder: Path, running: Path, source: Path) -> LoopRun:
    """Prepare another loop beside a running one."""
    paths = StagePaths("rig", folder / "runtime", folder / "state")
    paths.make_folders()
    old = Accepted(running)
    return asyncio.run(prepare(old, paths, source))  # type: ignore[arg-type] # all that it uses


@pytest.mark.fault("P11")
def test_invalid_file_is_refused_with_all_its_mistakes(tmp_path: Path, rig_file: Path) -> None:
    """A reload reports the same text as a start."""
    (tmp_path / "wrong").mkdir()
    path = configuration(tmp_path / "wrong", rate_hz="0", speed_um_per_s="fast")

    with pytest.raises(BadValueError, match=r"(?s)rate_hz: out of range.*speed_um_per_s: must be"):
        prepared(tmp_path, rig_file, path)


def test_missing_file_is_refused(tmp_path: Path, rig_file: Path) -> None:
    """A missing file changes nothing."""
    with pytest.raises(BadValueError, match=r"gone\.yaml"):
        prepared(tmp_path, rig_file, tmp_path / "gone.yaml")


def test_other_axes_need_a_restart(tmp_path: Path, rig_file: Path) -> None:
    """Readers, recordings and leases depend on the axes."""
    other = tmp_path / "other.yaml"
    other.write_text(rig_file.read_text("utf-8").replace("  x:\n", "  y:\n"), encoding="utf-8")

    with pytest.raises(NotNowError, match="its axes are y, those in force are x"):
        prepared(tmp_path, rig_file, other)


@pytest.mark.parametrize(
    ("path", "kept"),
    [
        ("rate_hz", {"x"}),
        ("axes.x.speed_um_per_s", {"x"}),
        ("axes.x.model", {"x"}),
        ("axes.x.sensor.device", set()),
        ("axes.x.compensator.identifier", set()),
        ("axes.y.sensor.device", {"x"}),
        ("devices.rig.seed", set()),
    ],
)
def test_learned_parameters_belong_to_the_devices(
    rig_file: Path, path: str, kept: set[str]
) -> None:
    """A changed device or compensator ends the parameters of its axes, any other value does not.

    A changed model replaces the weights and leaves the zero.
    """
    assert kept_axes(accept.load(rig_file), [path]) == kept


@pytest.mark.parametrize("stopped", [True, False])
def test_faults_are_handed_on_as_they_are(tmp_path: Path, stopped: bool) -> None:
    """Every latched fault reaches the next loop, whatever its bit."""
    shared = create(tmp_path / "loop.map", Layout(("x",), 64, 1_000_000))
    first = succession_of(shared)
    succession = Succession(mask(rule.id for rule in FAULTS), stopped)

    put_succession(shared, succession)

    assert first is None
    assert succession_of(shared) == succession


class Kept:
    """An accepted configuration, as far as `changes` uses it."""

    def __init__(self, source: Path, folder: Path) -> None:
        named: dict[str, str] = {}
        config = accept.load(source, named_files=named)
        self.config_file = accepted_config.keep(config, folder, "rig")
        self.source_files = SourceFiles(source)
        self.source_files.add(named)


def test_changes_are_named_by_their_paths(tmp_path: Path, rig_file: Path) -> None:
    """A value that is left out is a change, and so is a model file with other contents."""
    old = Kept(rig_file, tmp_path / "config-a")
    path = configuration(tmp_path, rate_hz="50", speed_um_per_s="100")
    new = Kept(path, tmp_path / "config-b")
    compared = changes(old, new)  # type: ignore[arg-type] # all that it uses
    model = tmp_path / "config-b" / "model-x.yaml"
    model.write_text(model.read_text("utf-8") + "# another\n", encoding="utf-8")
    again = changes(old, new)  # type: ignore[arg-type] # all that it uses

    assert compared == ["axes.x.speed_um_per_s", "rate_hz"]
    assert again == ["axes.x.model", *compared]


@pytest.mark.fault("P11")
def test_file_of_a_driver_with_other_contents_is_a_change(tmp_path: Path) -> None:
    """A DBC file is read again only by another loop, so that a reload must start one."""
    devices = REPOSITORY / "config" / "devices"
    text = (devices / "can-dbc.yaml").read_text("utf-8")
    path, dbc = tmp_path / "rig.yaml", tmp_path / "can-dbc-demo.dbc"
    path.write_text(text.replace("../models/", f"{devices.parent}/models/"), encoding="utf-8")
    shutil.copyfile(devices / dbc.name, dbc)
    old, same = Kept(path, tmp_path / "config-a"), Kept(path, tmp_path / "config-b")
    dbc.write_text(dbc.read_text("utf-8") + "\n", encoding="utf-8")
    new = Kept(path, tmp_path / "config-c")

    assert old.source_files.changed()
    assert changes(old, same) == []  # type: ignore[arg-type] # all that it uses
    assert changes(old, new) == ["devices.stage.options.dbc"]  # type: ignore[arg-type] # as above
