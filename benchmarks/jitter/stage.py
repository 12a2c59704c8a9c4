"""piezod's own loop on the simulated rig: an ordinary daemon, read from its ring."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.jitter.contenders import Lateness, Pacing
from piezod.client.stage_client import StageClient
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.errors import ClientError
from piezod.telemetry.arrays import RingReader
from piezod.telemetry.shared_map import SharedMap, attach
from piezod.telemetry.words import Word

REPOSITORY = Path(__file__).parents[2]
COMPILED = REPOSITORY / "build" / "compiled"
SHIPPED = REPOSITORY / "config" / "simulated.yaml"
LOAD = ("streams", *5 * ("requests",))
STARTED_WITHIN_S = 90.0
SETTLED_S = 1.0
ARMED_WITHIN_S = 10.0
SINE = {"kind": "sine", "low": 1.0, "high": 20.0, "frequency_hz": 2.0}


class Stage:
    """A daemon that follows a sine adaptively.

    Args:
        client: A client of it.
        shared: Shared memory of its loop, read only.
    """

    def __init__(self, client: StageClient, shared: SharedMap) -> None:
        self._client, self._shared = client, shared
        self.socket = client.socket
        self.report: list[dict[str, Any]] = shared.report()["steps"]
        """What the loop obtained of its real-time set-up."""
        self.left_run: list[str] = []
        """What kept the stage from following the sine, run by run."""

    @property
    def counters(self) -> dict[str, int]:
        """Counters of the loop."""
        words = (Word.MINOR_FAULTS, Word.MAJOR_FAULTS, Word.GC_COLLECTIONS, Word.ALLOCATED_BLOCKS)
        return {word.name.lower(): self._shared.words[word] for word in words}

    def measure(self, seconds: float) -> Lateness:
        """Return the loop's own record of a time without requests.

        Raises:
            ClientError: If the stage cannot be armed, for example because the rate is too high.
        """
        self._follow()
        reader = RingReader(self._shared)
        before = reader.newest
        time.sleep(seconds)
        records = reader.last(reader.newest - before)
        wrote = records[records["write_late_ns"] >= 0]
        if not np.all(records["state"] == list(State).index(State.RUN)):
            status = self._client.status()
            faults = ", ".join(str(fault) for fault in status.faults)
            self.left_run.append(f"not in RUN all the time, now {status.state}: {faults}")
        skipped = int(records["skipped"][-1] - records["skipped"][0])
        busy_ns = np.array(records["read_ns"] + records["compute_ns"] + records["write_ns"])
        return Lateness(
            np.array(records["late_ns"]), np.array(wrote["write_late_ns"]), skipped, busy_ns
        )

    def _follow(self) -> None:
        end_s = time.monotonic() + ARMED_WITHIN_S
        while self._client.status().state != State.RUN:
            try:
                if self._client.status().state == State.FAULT:
                    self._client.reset(engineer=True)
                self._client.arm()
                self._client.mode(Mode.ADAPTIVE)
                self._client.wave(dict.fromkeys(self._shared.layout.axes, SINE), 3600.0)
            except ClientError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(0.2)
        time.sleep(SETTLED_S)

    @contextmanager
    def loaded(self) -> Iterator[Mapping[str, float]]:
        """Put load on the daemon; afterwards the mapping has the actual load."""
        told: Counter[str] = Counter()
        self._client.start_recording("jitter")
        with ExitStack() as loads:
            burdens = [loads.enter_context(self._burden(what)) for what in LOAD]
            pipes = [(one.stdin, one.stdout) for one in burdens if one.stdin and one.stdout]
            for _, told_by in pipes:
                told_by.readline()  # "ready"
            try:
                yield told
            finally:
                for ended_by, _ in pipes:
                    ended_by.close()
                for _, told_by in pipes:
                    told.update(json.loads(told_by.read()))
        recording = self._client.stop_recording()
        told.update({"recorded": recording.records, "recording lost": recording.lost})

    def _burden(self, what: str) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", "benchmarks.jitter.load", str(self._client.socket), what]
        return subprocess.Popen(  # noqa: S603 - our own module
            command, cwd=REPOSITORY, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )


def configured(pacing: Pacing, axes: int) -> str:
    """Return the text of a configuration: the shipped one, with a rig for each axis."""
    document = yaml.safe_load(SHIPPED.read_text(encoding="utf-8"))
    axis, rig = document["axes"]["x"], document["devices"]["rig"]
    axis["model"] = str(SHIPPED.parent / axis["model"])
    names = "xyzabcuvw"[:axes]
    document["rate_hz"] = pacing.rate_hz
    document["devices"] = {f"rig_{name}": rig for name in names}
    document["axes"] = {
        name: {**axis, "amplifier": f"rig_{name}", "sensor": f"rig_{name}"} for name in names
    }
    spin_us = pacing.spin_ns / 1000
    document["loop"] = {"spin_us": spin_us, "priority": pacing.priority, "cpu": pacing.cpu}
    return json.dumps(document)


@contextmanager
def running(pacing: Pacing, *, axes: int = 1, build: Path | None = None) -> Iterator[Stage]:
    """Start a daemon with its own folders.

    Args:
        pacing: Rate, priority, processor and spin of its loop.
        axes: Number of its axes.
        build: Folder with a build of piezod; None for the one that runs here.
    """
    with tempfile.TemporaryDirectory(prefix="pz-", dir="/dev/shm") as folder:
        config = Path(folder) / "stage.yaml"
        config.write_text(configured(pacing, axes), encoding="utf-8")
        environ = {**os.environ, "XDG_RUNTIME_DIR": folder, "XDG_STATE_HOME": folder}
        if build is not None:
            environ["PYTHONPATH"], environ["PYTHONSAFEPATH"] = str(build), "1"
        command = [sys.executable, "-m", "piezod.cli.main", "run", str(config)]
        with (
            Path(folder, "log").open("wb") as log,
            subprocess.Popen(command, env=environ, stdout=log, stderr=log) as daemon,  # noqa: S603 - ours
        ):
            try:
                runtime = Path(folder) / "piezod" / "stage"
                with StageClient(socket=_socket(runtime, daemon)) as client:
                    yield Stage(client, attach(runtime / "loop.map"))
            finally:
                daemon.terminate()
                daemon.wait(timeout=30)


def _socket(runtime: Path, daemon: "subprocess.Popen[bytes]") -> Path:
    end_s = time.monotonic() + STARTED_WITHIN_S
    while time.monotonic() < end_s:
        if daemon.poll() is not None:
            break
        try:
            if attach(runtime / "loop.map").words[Word.HEALTHY_CYCLES]:
                return runtime / "api.sock"
        except OSError:
            pass
        time.sleep(0.1)
    raise SystemExit(f"piezod run did not start; see {runtime.parents[1] / 'log'}")
