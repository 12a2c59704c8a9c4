"""The exchange of a loop for one with another configuration, with loops that drive nothing."""

import asyncio
import sys
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.daemon.paths import StagePaths
from piezod.daemon.service.stage_service import BadValueError, NotNowError
from piezod.daemon.supervisor import accepted_config
from piezod.daemon.supervisor import loop_run as loop_supervision
from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.daemon.supervisor.reload import changes, exchange, read_again
from tests.daemon.daemons import configuration

FAKE = Path(__file__).parents[1] / "fake_loop.py"


@pytest.fixture(autouse=True)
def _fake_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    def started(_module: str, *arguments: str) -> "Popen[bytes]":
        return Popen([sys.executable, str(FAKE), *arguments])

    monkeypatch.setattr(loop_supervision, "_start", started)


@pytest.fixture
def config(rig_file: Path) -> DaemonConfig:
    """Return the configuration of a simulated stage."""
    return accepted_config.load(rig_file)


class Exchanged:
    """What an exchange left behind.

    Args:
        folder: Folder for the files of the stage.
        old: The configuration before.
        new: The configuration to exchange it for.
    """

    def __init__(self, folder: Path, old: DaemonConfig, new: DaemonConfig) -> None:
        self.runs: list[LoopRun] = []
        self._paths = StagePaths("rig", folder / "runtime", folder / "state")
        self._paths.make_folders()
        self.came_up = asyncio.run(self._exchange(old, new))

    async def _exchange(self, old: DaemonConfig, new: DaemonConfig) -> bool:
        self.runs.append(LoopRun(self._paths, old, "config-a"))
        self.runs[0].start()
        watching = asyncio.create_task(self._watch())
        try:
            while not self.runs[0].loop.health.started:
                await asyncio.sleep(0.01)
            came_up = await exchange(self.runs[0], self._paths, new, self.runs.append)
            self.code_of_first = self.runs[0].exit_code
            self.config = self.runs[-1].loop.config
            self.kept = accepted_config.load(self.runs[-1].config_file)
            while self.runs[-1].exit_code is None and self.runs[-1].ask_to_end():
                await asyncio.sleep(0.01)
        finally:
            watching.cancel()
        return came_up

    async def _watch(self) -> None:
        while True:
            self.runs[-1].loop.health.look(0)
            await asyncio.sleep(0.005)


def test_new_configuration_is_in_force(tmp_path: Path, config: DaemonConfig) -> None:
    """The loop before ended in order, and the new one runs what was validated."""
    new = config.model_copy(update={"title": "new"})

    exchanged = Exchanged(tmp_path, config, new)

    assert exchanged.came_up
    assert exchanged.code_of_first == 0
    assert exchanged.config.title == exchanged.kept.title == "new"


@pytest.mark.fault("P11")
def test_configuration_that_does_not_come_up_is_taken_back(
    tmp_path: Path, config: DaemonConfig
) -> None:
    """A loop with the old configuration runs again, from its own copy."""
    broken = config.model_copy(update={"title": "broken"})

    exchanged = Exchanged(tmp_path, config, broken)

    assert not exchanged.came_up
    assert [run.exit_code for run in exchanged.runs] == [0, 3, 0]
    assert exchanged.config == config
    assert exchanged.kept.title == config.title


def _read(path: Path, old: DaemonConfig) -> DaemonConfig:
    return asyncio.run(read_again(path, old, strict_rt=False))


@pytest.mark.fault("P11")
def test_invalid_file_is_refused_with_all_its_mistakes(
    tmp_path: Path, config: DaemonConfig
) -> None:
    """Whoever reloads reads the same text as whoever starts."""
    path = configuration(tmp_path, rate_hz="0", speed_um_per_s="fast")

    with pytest.raises(BadValueError, match=r"(?s)rate_hz: out of range.*speed_um_per_s: must be"):
        _read(path, config)


def test_missing_file_is_refused(tmp_path: Path, config: DaemonConfig) -> None:
    """A file that is gone changes nothing."""
    with pytest.raises(BadValueError, match=r"gone\.yaml"):
        _read(tmp_path / "gone.yaml", config)


def test_other_axes_need_a_restart(rig_file: Path, config: DaemonConfig) -> None:
    """Readers, recordings and leases count on the axes that there are."""
    other: dict[str, Any] = {"axes": {"y": config.axes["x"]}}
    old = config.model_copy(update=other)

    with pytest.raises(NotNowError, match="its axes are x, those in force are y"):
        _read(rig_file, old)


def test_changes_are_named_by_their_paths(tmp_path: Path, config: DaemonConfig) -> None:
    """A value that is left out is one that changed too."""
    path = configuration(tmp_path, rate_hz="50", speed_um_per_s="100")

    assert changes(config, accepted_config.load(path)) == ["axes.x.speed_um_per_s", "rate_hz"]
