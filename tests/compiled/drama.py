"""A stage with everything that happens to it, drawn from a seed, and a digest of its records.

`python -m tests.compiled.drama CYCLES` prints the digest of each scene as JSON. Builds that compute
alike print the same.
"""

import hashlib
import json
import sys
import tempfile
import time
from pathlib import Path
from random import Random
from typing import Any, Final, cast

import yaml

from benchmarks.virtual_loop import VirtualLoop
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.devices import registry
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.stream import StreamWriter
from piezod.telemetry.words import Word
from piezod.testing.faulty import FaultyDevice, SensorAmplifier
from piezod.testing.injections import Injection, InjectionKind
from tests.control.surface_rig import VARIANTS, model_path

CONFIG: Final = Path(__file__).parents[2] / "config"
RESPONSE: Final = str(CONFIG / "responses" / "simulated-stack.yaml")
SCENES: Final[dict[str, dict[str, Any]]] = {
    "stops": {},
    "adaptive trim": {"trim": {"base": "adaptive", "gain_per_s": 50}},
    "response": {"response": RESPONSE, "first_mode": None, "trim": {"proportional": 0.05}},
    "no mode": {"first_mode": None},
    "lms": {"model": None, "compensator": {"identifier": "lms"}},
    "nlms": {"model": None, "compensator": {"identifier": "nlms"}},
    "surface": {"model": "surface"},
    "lag": {"model": "lag"},
    "path": {"model": "path"},
    "open loop": {"sensor": None},
    "two axes": {},
}
"""Changes of the axis in each scene."""
_SCENE_CYCLES: Final = 250


def config_of(scene: str, folder: Path) -> DaemonConfig:
    """Return the configuration of a scene."""
    document = yaml.safe_load((CONFIG / "simulated.yaml").read_text(encoding="utf-8"))
    document["rate_hz"] = 1000
    axis: dict[str, Any] = document["axes"]["x"]
    axis["model"] = "stops"
    for name, value in SCENES[scene].items():
        axis[name] = {**axis[name], **value} if isinstance(value, dict) else value
    if axis["model"] is not None:
        document["devices"]["rig"]["options"]["variant"] = VARIANTS[axis["model"]]
        axis["model"] = str(model_path(axis["model"]))
    axis = document["axes"]["x"] = {key: value for key, value in axis.items() if value is not None}
    if scene == "two axes":
        document["axes"]["y"] = axis
    path = folder / "stage.yaml"
    path.write_text(json.dumps(document), encoding="utf-8")
    return load_daemon(path, registry)


class Drama:
    """A stage to which things happen."""

    def __init__(self, scene: str, folder: Path) -> None:
        self.config = config_of(scene, folder)
        self._random = Random(scene)  # noqa: S311 - no secret
        self.loop = VirtualLoop(
            self.config, folder, lambda device: FaultyDevice(cast("SensorAmplifier", device))
        )
        self._stream = StreamWriter(self.loop.shared)
        self.refusals: list[str] = []

    def play(self, cycles: int) -> str:
        """Run cycles; return the digest of all records and answers."""
        digest = hashlib.sha256()
        for _ in range(cycles // _SCENE_CYCLES):
            for request in self._requests():
                self.refusals.append(self.loop.do(request))
                self.loop.run(self._random.randint(1, 40))
            self._disturb()
            for _ in range(_SCENE_CYCLES // 2):
                self._stream.set(0, self._random.uniform(5.0, 15.0), self.loop.clock.t_ns)
                self.loop.run(2)
            digest.update(records_of(self.loop.shared))
        digest.update("\n".join(self.refusals).encode())
        return digest.hexdigest()

    def _requests(self) -> list[rq.Request]:
        """Return what is asked for next: mostly a movement."""
        draw, names = self._random, list(self.config.axes)
        wave = Sine(kind="sine", low=2.0, high=20.0, frequency_hz=draw.choice([2.0, 17.0]))
        drive = Sine(kind="sine", low=0.0, high=60.0, frequency_hz=20.0)
        moves: list[rq.Request] = [
            rq.Wave(command_um=dict.fromkeys(names, wave), duration_s=0.3),
            rq.Goto(axis="x", position_um=draw.uniform(0.0, 26.0)),
            rq.Stream(axes=("x",)),
        ]
        seldom: list[rq.Request] = [
            rq.Hold(),
            rq.Resume(),
            rq.Stop(),
            rq.Estop(),
            rq.Zero(axis="x"),
            rq.Condition(axis="x"),
            rq.Identify(drive_v={"x": drive}, duration_s=0.1),
            rq.Arm(shadow=True),
        ]
        up: list[rq.Request] = [rq.Reset(engineer=True), rq.Arm(confirm_output=True), rq.Resume()]
        chosen = moves if draw.random() < 0.8 else seldom
        return [*up, rq.SelectMode(mode=draw.choice(list(Mode))), draw.choice(chosen)]

    def _disturb(self) -> None:
        """Let a fault of a device begin now and then, or let the loop stand still."""
        draw, now_ns = self._random, self.loop.clock.t_ns
        if draw.random() < 0.2:
            self.loop.clock.oversleeps_ns = draw.choice([600_000, 4_500_000, 1_200_000_000])
        if draw.random() > 0.4:
            return
        end_ns = now_ns + draw.choice([1, 5, 30, 200]) * 1_000_000
        flag = draw.choice(list(DeviceFlag))
        value = draw.choice([0.5, 3.0, -1.0, 40.0])
        for device in self.loop.devices.values():
            kind = draw.choice(list(InjectionKind))
            if kind is InjectionKind.LATE:
                value = 4_000_000.0
            cast("FaultyDevice", device).schedule = [
                Injection(kind, now_ns + 1, end_ns, 0, value, flag)
            ]


def records_of(shared: SharedMap) -> bytes:
    """Return all of the shared memory that the loop writes in a cycle."""
    parts = ("ring", "counts", "learned", "events")
    words = [int(Word.LOOP_STATE), int(Word.SKIPPED_CYCLES), int(Word.HEALTHY_CYCLES)]
    return b"".join(bytes(shared.part(name)) for name in parts) + bytes(
        str([shared.words[word] for word in words]), "ascii"
    )


def digests(cycles: int) -> dict[str, str]:
    """Return the digest of each scene."""
    found = {}
    for scene in SCENES:
        with tempfile.TemporaryDirectory() as folder:
            found[scene] = Drama(scene, Path(folder)).play(cycles)
    return found


def stop_clocks() -> None:
    """Let the clocks of the machine stand still: on a busy one they seem to jump."""
    time.monotonic_ns = time.time_ns = lambda: 0
    time.clock_gettime_ns = lambda _clock: 0


if __name__ == "__main__":
    stop_clocks()
    print(json.dumps(digests(int(sys.argv[1]))))
