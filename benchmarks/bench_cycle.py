"""Processor time of one cycle of the loop, interpreted and compiled.

`python benchmarks/bench_cycle.py` runs the real `Loop`, with publisher and shared memory, in
virtual time. It prints µs of processor time, the minimum over rounds, of which each build has its
turn. The compiled build is the one that `make compiled` has made; without it there is no such
column. `--against FOLDER` measures another checkout in the same run; `--json` is for programs.
"""

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple, cast

if TYPE_CHECKING:
    from benchmarks.virtual_loop import VirtualLoop

ROOT: Final = Path(__file__).parents[1]
COMPILED: Final = ROOT / "build" / "compiled"
RATE_HZ: Final = 1000
CYCLES: Final = 200


class Case(NamedTuple):
    """What runs."""

    axes: int = 1  #: Number of axes.
    mode: str = "adaptive"  #: Mode of the movement; empty for a stage at rest.
    rig: bool = True  #: Whether the devices are the simulated rig; else they cost nothing.


CASES: Final = {
    "": Case(),
    "feedforward": Case(mode="feedforward"),
    "trimmed": Case(mode="trimmed"),
    "no_device": Case(rig=False),
    "at_rest": Case(mode=""),
    "3_axes": Case(axes=3),
    "8_axes": Case(axes=8),
}
"""The cases; the first has no name in the results."""


class FreeDevices:
    """Devices of zero cost below the boundary: positions follow the drive and never repeat."""

    def __init__(self, devices: Any, axes: int) -> None:
        from piezod.devices.interface import Sample  # noqa: PLC0415 - of the measured build
        from piezod.devices.status import NO_FLAGS  # noqa: PLC0415 - likewise

        self._devices, self._sample = devices, Sample
        self._flags, self._drive_v, self._cycle = [NO_FLAGS] * (2 * axes), [0.0] * axes, 0

    def __getattr__(self, name: str) -> Any:
        """Return a method of the devices."""
        return getattr(self._devices, name)

    def read(self, now_ns: int) -> list[Any]:
        """Return samples in proportion to the drives."""
        self._cycle += 1
        dither_um = 0.003 * ((self._cycle * 7919) % 97 / 97 - 0.5)
        return [self._sample(now_ns, 0.2115 * v + dither_um, True) for v in self._drive_v]

    def read_back(self, _now_ns: int) -> list[float]:
        """Return the last write."""
        return self._drive_v

    def write(self, drive_v: Sequence[float], _now_ns: int) -> bool:
        """Take voltages."""
        self._drive_v = list(drive_v)
        return True

    def status(self, _now_ns: int) -> list[Any]:
        """Return no flags."""
        return self._flags


def make_loop(case: Case, folder: Path) -> "VirtualLoop":
    """Return the loop of a stage which is in the state of a case."""
    from benchmarks.virtual_loop import VirtualLoop  # noqa: PLC0415 - of the measured build

    def devices(channels: Any) -> Any:
        return channels if case.rig else FreeDevices(channels, case.axes)

    loop = VirtualLoop(config_of(case, folder), folder, replace=devices)
    loop.run(20)
    if case.mode:
        move(case, loop)
    return loop


def config_of(case: Case, folder: Path) -> Any:
    """Return the configuration of a case: the shipped one, with more axes."""
    import yaml  # noqa: PLC0415 - in the process that measures

    from piezod.config.daemon import load_daemon  # noqa: PLC0415 - likewise
    from piezod.devices import registry  # noqa: PLC0415 - likewise

    document = yaml.safe_load((ROOT / "config" / "simulated.yaml").read_text())
    axis, rig = document["axes"]["x"], document["devices"]["rig"]
    axis["model"] = str(ROOT / "config" / axis["model"])
    names = [f"a{i}" for i in range(case.axes)]
    document["rate_hz"] = RATE_HZ
    document["devices"] = {f"rig_{name}": rig for name in names}
    document["axes"] = {
        name: {**axis, "amplifier": f"rig_{name}", "sensor": f"rig_{name}"} for name in names
    }
    path = folder / "stage.yaml"
    path.write_text(json.dumps(document))
    return load_daemon(path, registry)


def move(case: Case, loop: "VirtualLoop") -> None:
    """Arm a stage and let all its axes follow a sine."""
    from piezod.config.modes import Mode  # noqa: PLC0415 - in the process that measures
    from piezod.config.waveforms.shapes import Sine  # noqa: PLC0415 - likewise
    from piezod.messages import requests  # noqa: PLC0415 - likewise

    sine = Sine(kind="sine", low=2.0, high=20.0, frequency_hz=2.0)
    waves: dict[str, Any] = {axis.name: sine for axis in loop.controller.axes}
    for request, seconds in (
        (requests.Arm(), 0.3),
        (requests.SelectMode(mode=Mode(case.mode)), 0.0),
        (requests.Wave(command_um=waves, duration_s=3600.0), 1.2),
    ):
        if why := loop.do(request):
            raise SystemExit(f"{request.kind}: {why}")
        loop.run(round(seconds * RATE_HZ))


def serve(case: Case) -> None:
    """Measure a round for each line of the standard input."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        loop = make_loop(case, Path(folder))
        gc.collect()
        gc.freeze()
        gc.disable()
        print("ready", flush=True)
        for _ in sys.stdin:
            begin_ns = time.thread_time_ns()
            loop.run(CYCLES)
            print((time.thread_time_ns() - begin_ns) / CYCLES / 1e3, flush=True)


def start(build: Path, name: str) -> "subprocess.Popen[str]":
    """Start the process that measures a case of a build."""
    environment = {**os.environ, "PYTHONPATH": f"{build}:{build / 'drivers'}"}
    command = [sys.executable, __file__, "--serve", name]
    process = subprocess.Popen(  # noqa: S603 - this file
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    if cast("IO[str]", process.stdout).readline() != "ready\n":
        raise SystemExit(f"{build}: the case {name!r} does not run")
    return process


def measure(builds: dict[str, Path], name: str, rounds: int) -> dict[str, float]:
    """Return the processor time of a cycle of each build, in µs: the minimum of its rounds."""
    processes = {build: start(folder, name) for build, folder in builds.items()}
    found = dict.fromkeys(builds, float("inf"))
    for _ in range(rounds):
        for build, process in processes.items():
            print(file=process.stdin, flush=True)
            found[build] = min(found[build], float(cast("IO[str]", process.stdout).readline()))
    for process in processes.values():
        process.communicate()
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--against", type=Path, help="another checkout, measured as `before`")
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--case", action="append", help="only this case; can be repeated")
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve is not None:
        serve(CASES[options.serve])
        return
    builds = {"interpreted": ROOT}
    if COMPILED.exists():
        builds["compiled"] = COMPILED
    if options.against:
        builds["before"] = options.against.resolve()
    found = {name: measure(builds, name, options.rounds) for name in options.case or CASES}
    if options.json:
        flat = {
            f"{build}_{name}_us".replace("__", "_"): round(us, 2)
            for name, each in found.items()
            for build, us in each.items()
        }
        print(json.dumps(flat))
        return
    print(f"{'µs a cycle':24}" + "".join(f"{build:>14}" for build in builds))
    for name, each in found.items():
        row = "".join(f"{us:14.1f}" for us in each.values())
        print(f"{name.replace('_', ' ') or 'one axis, adaptive':24}{row}")


if __name__ == "__main__":
    main()
