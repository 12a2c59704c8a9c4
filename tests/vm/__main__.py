"""The wheel of this checkout in a virtual machine: `python -m tests.vm`, as `make vm` runs it.

Builds the machine, boots it, installs the wheel in it, and makes the checks of `tests/vm/guest`.
Exits with 1 if one failed, with 2 if something is missing here. What the guest has printed and
logged is in build/vm/run. With first words of checks, as in `python -m tests.vm comedi iio`, only
these are made.
"""

import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from tests.drivers.bus.bench import emulated
from tests.vm import image, report, wheels
from tests.vm.virtual_machine import BEHIND_USB, booted

_ROOT: Final = Path(__file__).parents[2]
_CACHE: Final = _ROOT / "build" / "vm"
_SHARED: Final = ("tests/vm/guest",)
_SILENCE_S: Final = 900
"""After this long without a line from the guest it counts as hung."""


def main() -> int:
    """Build, boot, check; return the exit code."""
    if reasons := image.missing():
        print("\n".join(f"make vm: {reason}" for reason in reasons), file=sys.stderr)
        return 2
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as Ctrl-C does: end the machine first
    begin_s = time.monotonic()
    share = _CACHE / "run"
    shutil.rmtree(share, ignore_errors=True)
    wheel = wheels.piezod(share / "wheels")
    libraries = wheels.libraries(_CACHE, wheel)
    disk = image.build(_CACHE, libraries)
    for name in _SHARED:
        shutil.copytree(_ROOT / name, share / name)
    (share / "only.txt").write_text(" ".join(sys.argv[1:]), "utf-8")
    image.compile_for(disk, share)
    built_s = time.monotonic()
    print(f"make vm: {built_s - begin_s:.0f} s to build; booting", flush=True)
    results = check(disk, share)
    text, code = report.verdict(results)
    print(f"make vm: {text}; {time.monotonic() - built_s:.0f} s in the guest; logs in {share}")
    return code


def check(disk: image.Image, share: Path) -> list[report.Result]:
    """Boot the machine, and return the results of its checks."""
    with (
        emulated("mdt694b") as amplifier,
        tempfile.TemporaryDirectory(prefix="pz-vm-") as folder,
        booted(disk, Path(folder), share, amplifier.where[0]) as (port, monitor),
        port.makefile("rw", encoding="utf-8", newline="\n") as lines,
    ):
        port.settimeout(_SILENCE_S)

        def answer(text: str) -> None:
            lines.write(text + "\n")
            lines.flush()

        requests: dict[str, Callable[[str], str]] = {
            "plug": lambda identity: monitor.plug(identity, BEHIND_USB),
            "unplug": monitor.unplug,
        }
        return report.serve(lines, answer, requests)


if __name__ == "__main__":
    sys.exit(main())
