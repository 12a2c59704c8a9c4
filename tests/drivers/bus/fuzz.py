"""Feeds the bytes of a fuzzer to drivers and emulators, guided by the lines that it reaches.

`make fuzz` runs it for every profile, each in a process of its own. It needs the package atheris,
which is not part of the development setup, because it has no wheels for every Python.
"""

import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec

from tests.drivers.bus.profiles import PROFILES
from tests.drivers.bus.test_fuzz import MOST_ANSWERED, use
from tests.drivers.bus.wire import MS, wired

SECONDS = 20


def _fuzz(name: str) -> None:
    """Feed one device and its driver until the time is over or something fails."""
    atheris = import_module("atheris")

    profile = next(each for each in PROFILES if each.name == name)
    with atheris.instrument_imports(include=["piezod_drivers"]), wired(profile) as wire:
        use(profile.maker("127.0.0.1:1", 20.0)(), wire)  # imports the driver

    def feed(data: bytes) -> None:
        with wired(profile) as wire:
            assert sum(map(len, wire.emulator.receive(data))) < MOST_ANSWERED
            provider = atheris.FuzzedDataProvider(data)
            wire.change = lambda reply: provider.ConsumeBytes(32) or reply
            use(profile.maker("127.0.0.1:1", 20.0)(), wire)
            wire.wait(MS)

    limits = [f"-max_total_time={SECONDS}", "-max_len=512", "-len_control=0", "-rss_limit_mb=1000"]
    atheris.Setup([sys.argv[0], *limits], feed)
    atheris.Fuzz()


def main() -> int:
    """Fuzz the given profile, or every one; return the exit code."""
    if sys.argv[1:]:
        _fuzz(sys.argv[1])
        return 0
    if find_spec("atheris") is None:
        print("make fuzz needs atheris: .venv/bin/pip install atheris")
        return 1
    failed = []
    for profile in PROFILES:
        print(f"--- {profile.name}", flush=True)
        run = subprocess.run(
            [sys.executable, "-m", "tests.drivers.bus.fuzz", profile.name], check=False
        )
        failed += [profile.name] if run.returncode else []
    print(f"failed: {', '.join(failed) or 'none'}")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
