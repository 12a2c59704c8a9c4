"""The memory of the loop while the machine has too little."""

import os
from pathlib import Path
from typing import Final

from tests.vm.guest.service import STAGE
from tests.vm.guest.shell import need, run, wait_until

_SWAP: Final = "/var/swap"
_FULL: Final = Path("/run/hog-is-full")
_TOO_MUCH_MB: Final = 200
"""By how much the memory of the machine is exceeded."""
_PAGE: Final = os.sysconf("SC_PAGE_SIZE")
# Each page is touched once: a second pass would swap all of them in and out again.
_HOG: Final = (
    "import mmap, pathlib, time; memory = mmap.mmap(-1, {} << 20); "
    "memory[::4096] = bytes([1]) * (len(memory) // 4096); "
    f"pathlib.Path('{_FULL}').touch(); time.sleep(3600)"
)


def loop_stays_in_memory() -> str:
    """Fill the memory of the machine; nothing that the loop has locked is swapped out."""
    loop = STAGE.loop
    run(f"fallocate -l 1G {_SWAP} && chmod 600 {_SWAP} && mkswap {_SWAP} && swapon {_SWAP}")
    try:
        swapped_mb = _fill_memory()
        locked_kb, locked_and_swapped_kb = _locked_kb(loop)
        status = STAGE.status()
    finally:  # with a full memory, the checks after this one would fail, too
        run(f"systemctl stop hog; swapoff {_SWAP}")
    need(swapped_mb > _TOO_MUCH_MB / 2, f"the machine has swapped out only {swapped_mb} MB")
    need(locked_kb > 0, "no memory of the loop is locked")
    need(not locked_and_swapped_kb, f"{locked_and_swapped_kb} kB of it were swapped out")
    STAGE.runs_on(loop, status)
    locked_mb = locked_kb // 1024
    return f"{swapped_mb} MB of others were swapped out, none of the {locked_mb} MB that are locked"


def _fill_memory() -> int:
    """Have a program take more memory than is available; return how much was swapped, in MB."""
    available_mb = int(run("awk '/^MemAvailable/ {print $2}' /proc/meminfo")) // 1024
    hog = _HOG.format(available_mb + _TOO_MUCH_MB)
    run(f'systemd-run --unit=hog -p OOMScoreAdjust=1000 /usr/bin/python3 -c "{hog}"')
    wait_until(_FULL.exists, "the memory is full", 600.0)
    return int(run("awk '/^pswpout/ {print $2}' /proc/vmstat")) * _PAGE >> 20


def _locked_kb(pid: int) -> tuple[int, int]:
    """Return how much of the locked ranges of a process is in memory and in the swap, in kB."""
    resident = swapped = 0
    here = {"Rss": 0, "Swap": 0}
    for line in Path(f"/proc/{pid}/smaps").read_text("ascii", "replace").splitlines():
        name, _, rest = line.partition(":")
        if name in here:
            here[name] = int(rest.split()[0])
        elif name == "VmFlags" and "lo" in rest.split():
            resident, swapped = resident + here["Rss"], swapped + here["Swap"]
    return resident, swapped
