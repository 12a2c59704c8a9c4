"""Feeds the bytes of a fuzzer to readers, drivers and emulators, guided by the lines it reaches.

`make fuzz` runs it for every target, each in a process of its own; `make fuzz TARGETS="model body"`
for some. It needs the package atheris, which `make fuzz` installs into an environment of its own.
"""

import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from tests.drivers.bus.fuzz import driver_and_emulator
from tests.drivers.bus.profiles import PROFILES
from tests.fuzz.readers import READERS

SECONDS: Final = 20
INSTRUMENTED: Final = ("piezod.config", "piezod.daemon", "piezod.records", "piezod_drivers")

Feed = Callable[[bytes], None]


def _fuzz(name: str, folder: Path) -> None:
    """Feed one target until the time is over or something fails."""
    atheris = import_module("atheris")
    import_module("piezod.hysteresis")  # numba cannot compile what atheris has changed
    seeds = folder / "seeds"
    seeds.mkdir()
    with atheris.instrument_imports(include=INSTRUMENTED):
        if name in READERS:
            reader = READERS[name]()
            (seeds / "good").write_bytes(reader.good)
            feed = _into(reader.survives, folder / "input")
        else:
            feed = driver_and_emulator(next(each for each in PROFILES if each.name == name))
    limits = [f"-max_total_time={SECONDS}", "-len_control=0", "-rss_limit_mb=1000", "-timeout=15"]
    most_bytes = f"-max_len={len(reader.good) + 64 if name in READERS else 512}"
    atheris.Setup([sys.argv[0], *limits, most_bytes, str(seeds)], feed)
    atheris.Fuzz()


def _into(survives: Callable[[bytes, Path], bool], path: Path) -> Feed:
    def feed(data: bytes) -> None:
        survives(data, path)

    return feed


def main(names: Sequence[str]) -> int:
    """Fuzz the named targets, or every one; return the number of those that failed."""
    failed = []
    for name in names or (*READERS, *(profile.name for profile in PROFILES)):
        print(f"--- {name}", flush=True)
        with TemporaryDirectory() as folder:
            command = (sys.executable, "-m", "tests.fuzz", "--one", name, folder)
            failed += [name] if subprocess.run(command, check=False).returncode else []
    print(f"failed: {', '.join(failed) or 'none'}")
    return len(failed)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        _fuzz(sys.argv[2], Path(sys.argv[3]))
    else:
        sys.exit(main(sys.argv[1:]))
