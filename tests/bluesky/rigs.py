"""Stages for the tests: a rig that knows the truth, its daemon, and the documents of a plan."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from event_model import DocumentNames, schema_validators

from piezod.units import NS_PER_S
from tests.daemon.daemons import REPOSITORY, Daemon, configuration

FloatArray: TypeAlias = npt.NDArray[np.float64]
CLOSE_UM: Final = 0.6
"""The tolerance of the stage, the resolution of its sensor, and the way between two samples."""


class Bench(NamedTuple):
    """A stage that leaves its true positions in a file."""

    daemon: Daemon  #: Its daemon.
    truth: Path  #: The file.

    def truths(self) -> tuple[FloatArray, FloatArray]:
        """Return all instants, in s on the monotonic clock, and the true displacements, in µm."""
        rows = self.truth.read_text(encoding="ascii").splitlines()[:-1]  # the last one may grow
        t_ns, true_um = np.array([row.split(",") for row in rows], np.float64).T
        return t_ns / NS_PER_S, true_um

    def true_um(self, t_s: float) -> float:
        """Return the true displacement at an instant, in µm."""
        return float(np.interp(t_s, *self.truths()))


@contextmanager
def bench(folder: Path, name: str) -> Iterator[Bench]:
    """Run a stage with the axis x while the block runs; it is disarmed at first.

    Args:
        folder: A folder for its files.
        name: Name of the stage.
    """
    truth = folder / f"{name}.csv"
    with TemporaryDirectory(prefix="pz-") as short:  # the path of a socket must be short
        socket = f"{short}/rig"
        config = configuration(
            folder,
            rig=f"{{driver: emulated, options: {{socket: {socket}, deadline_ms: 1000}}}}",
            rate_hz="20",
            speed_um_per_s="10",
            trim="{base: feedforward, gain_per_s: 5, authority_pct: 5}",
        ).rename(folder / f"{name}.yaml")
        with config.open("a", encoding="utf-8") as file:
            file.write("    conditioning: {frequency_hz: 2, cycles: 4}\n")
        command = [sys.executable, "-m", "tests.bluesky.truth_rig", socket, str(truth)]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, cwd=REPOSITORY, stdout=pipe, text=True) as rig:
            assert rig.stdout is not None
            try:
                assert rig.stdout.readline() == "serving\n"
                with Daemon(config) as daemon:
                    yield Bench(daemon.up(), truth)
            finally:
                rig.terminate()


class Documents:
    """The documents of plans, each valid for event-model; a callback of the RunEngine."""

    def __init__(self) -> None:
        self._all: list[tuple[str, dict[str, Any]]] = []

    def __call__(self, name: str, document: dict[str, Any]) -> None:
        """Take a document."""
        schema_validators[DocumentNames[name]].validate(document)
        self._all.append((name, document))

    def of(self, name: str) -> list[Any]:
        """Return the documents of a kind."""
        return [document for kind, document in self._all if kind == name]
