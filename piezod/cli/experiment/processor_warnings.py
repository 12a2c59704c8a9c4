"""Warnings of `piezod check` about the processor of a stage, on this machine and at present."""

import os
from pathlib import Path

from piezod.cli.experiment.processor_quota import processor_quota
from piezod.client.places import running_stages
from piezod.config.yaml_loader import load_yaml
from piezod.daemon.loop.processor import free_processors


def processor_warnings(file: Path) -> list[str]:
    """Return what is to be said about the processor of a stage that does not run."""
    return _quota_warnings() + _sharing_warnings(file)


def _quota_warnings() -> list[str]:
    if (quota := processor_quota()) is None:
        return []
    still_ms = (quota.period_s - quota.used_s) * 1e3
    return [
        f"the control group here has a quota of {quota.processors:g} processors (cpu.max; "
        f"systemd CPUQuota=, docker --cpus): a loop that has used it up stands still for up to "
        f"{max(still_ms, 0):.0f} ms (L2, L7); give the stage no quota, but a processor: loop.cpu"
    ]


def _sharing_warnings(file: Path) -> list[str]:
    if file.stem in running_stages():
        return []  # `piezod status` shows the processor that its loop has
    cpu = load_yaml(file).data.get("loop", {}).get("cpu")
    allowed = sorted(os.sched_getaffinity(0))
    numbers = ", ".join(map(str, allowed))
    if cpu is not None and cpu not in allowed:
        return [f"loop.cpu is {cpu}, and this user may use the processors {numbers} only"]
    if free_processors(allowed if cpu is None else [cpu]) != []:
        return []
    if cpu is not None:
        return [f"processor {cpu} (loop.cpu) has the loop of another stage already"]
    return [
        f"each of the processors {numbers} has the loop of another stage already: this stage would "
        "share one"
    ]
