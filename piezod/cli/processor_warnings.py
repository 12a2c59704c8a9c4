"""Warnings of `piezod check` about the processor of a stage, on this machine and at present."""

import os
from pathlib import Path

from piezod.client.places import running_stages
from piezod.config.yaml_loader import load_yaml
from piezod.daemon.loop.processor import free_processors


def processor_warnings(file: Path) -> list[str]:
    """Return what is to be said about the processor of a stage that does not run.

    Args:
        file: Configuration of the stage, valid.
    """
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
