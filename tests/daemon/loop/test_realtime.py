"""Requests to the operating system, each test in a process of its own, which it changes."""

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from tests.forked import SCRIPT, run

PARTS = """
import ctypes, mmap
import llvmlite.binding

private = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
# No other part is executable, and the kernel joins only equal ones.
apart = mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC
made = {
    "reserved": mmap.mmap(-1, 32 << 20, private, apart),
    "small": mmap.mmap(-1, 8 << 20, private),
}
"""
SET_UP = """
import gc, json, os, resource, sys
from pathlib import Path
from piezod.config.daemon import LoopConfig
from piezod.daemon.loop.realtime import Realtime
from piezod.telemetry.shared_map import attach

shared = attach(Path(sys.argv[1]), writable=True)
if sys.argv[2] == "powerless":
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    if os.getuid() == 0:
        os.setuid(65534)
realtime = Realtime(LoopConfig(), shared)
steps = realtime.set_up()
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(json.dumps({
    "steps": {step.name: step._asdict() for step in steps},
    "locked_kb": int(status["VmLck"].split()[0]),
    "cpus": len(os.sched_getaffinity(0)),
    "policy": os.sched_getscheduler(0),
    "collecting": gc.isenabled(),
    "frozen": gc.get_freeze_count(),
    "policy afterwards": (realtime.leave(), os.sched_getscheduler(0))[1],
}))
"""
RESIDENT = """
from piezod.daemon.loop.memory import mappings

made["future"] = mmap.mmap(-1, 4 << 20, private)
parts = list(mappings())

def resident(memory):
    address = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    part = next(each for each in parts if each.begin <= address < each.begin + each.size)
    return part.resident_kb * 1024 / part.size

found = {name: resident(memory) for name, memory in made.items()}
compiler = [
    each for each in parts if "llvmlite" in each.file or "openblas" in each.file
]
found["compiler"] = sum(each.resident_kb for each in compiler if not each.changed_kb)
found["compiler data"] = sum(each.resident_kb for each in compiler if each.changed_kb)
print(json.dumps(found))
"""
STACK = """
import sys, threading
from pathlib import Path
from piezod.daemon.loop import process

process.main(*map(Path, ["absent"] * 4), strict_rt=False, warm=False)
print(threading.stack_size(), file=sys.stderr)
"""


@cache
def set_up(power: str) -> list[dict[str, Any]]:
    """Set up real time in a process; return its own report, and what is in RAM."""
    with TemporaryDirectory() as folder:
        map_file = Path(folder) / "loop.map"
        create(map_file, Layout(("x",), 64, 1_000_000))
        command = [sys.executable, "-c", PARTS + SET_UP + RESIDENT, str(map_file), power]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.parametrize("power", ["as it is", "powerless"])
def test_report_agrees_with_the_kernel(power: str) -> None:
    """A step is reported as obtained if and only if the kernel agrees."""
    found, _ = set_up(power)

    steps = found["steps"]
    assert steps["memory"]["ok"] == (found["locked_kb"] > 0)
    assert steps["scheduling"]["ok"] == (found["policy"] & os.SCHED_FIFO != 0)
    assert steps["processor"]["ok"] == (found["cpus"] == 1)
    assert steps["garbage collection"]["ok"]
    assert not found["collecting"]
    assert found["frozen"] > 0
    assert found["policy afterwards"] & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER


@pytest.mark.fault("L9")
def test_process_without_rights_reports_the_remedy() -> None:
    """A process without rights runs on, and the report says why and what helps."""
    steps = set_up("powerless")[0]["steps"]

    assert not steps["scheduling"]["ok"]
    assert "run as the service does, or as root" in steps["scheduling"]["obtained"]


def test_priority_is_raised_last_and_memory_locked_after_the_heap() -> None:
    """The order is the one in which no step undoes another."""
    names = list(set_up("as it is")[0]["steps"])

    assert names[-1] == "scheduling"
    assert names.index("heap") < names.index("memory") < names.index("garbage collection")


def test_memory_that_no_cycle_uses_is_left_out() -> None:
    """Compiler, OpenBLAS and large untouched memory are not in RAM; all other memory is."""
    report, found = set_up("as it is")

    if not report["steps"]["memory"]["ok"]:
        pytest.skip("this user may not lock memory")
    assert (found["reserved"], found["compiler"]) == (0.0, 0)
    assert (found["small"], found["future"]) == (1.0, 1.0)
    assert found["compiler data"] > 0


def test_stacks_of_threads_are_small() -> None:
    """Every thread of the loop process has a stack of 1 MB, because all of it is locked in RAM."""
    done = run((STACK,), module=SCRIPT)

    assert done.returncode == 0
    assert done.stderr == "1048576\n"
