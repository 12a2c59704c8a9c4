"""Through how many files one cycle passes: `python -m tests.trace_cycle` prints the way.

A stage on the simulated rig is armed and moves in mode adaptive; one of its cycles runs under a
trace. A file counts if a Python function of it runs, the driver and the simulated physics included.
Kernels that numba compiled run no Python and do not count.
"""

import sys
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.messages import requests
from tests.control.rig_stage import ON_TIME, RigStage

ROOT = Path(__file__).parents[1]


class Step(NamedTuple):
    """One function on the way."""

    depth: int  #: How many functions of ours are being run, this one included.
    file: str  #: Its file, relative to the repository.
    function: str  #: Its name.


def trace() -> list[Step]:
    """Return the functions that one cycle in RUN and adaptive runs, in order."""
    stage = RigStage()
    stage.until(State.SAFE)
    stage.do(requests.Arm(), requests.SelectMode(mode=Mode.ADAPTIVE))
    stage.do(requests.Goto(axis="x", position_um=12.0))
    stage.run(0.1)
    steps: list[Step] = []
    depths = {0: 0}

    def of(frame: FrameType, event: str, _argument: Any) -> Any:
        file = Path(frame.f_code.co_filename)
        ours = file.is_relative_to(ROOT) and file.parts[len(ROOT.parts)] in {"piezod", "drivers"}
        depth = depths.get(id(frame.f_back), 0) + ours
        depths[id(frame)] = depth
        if event == "call" and ours:
            steps.append(Step(depth, str(file.relative_to(ROOT)), frame.f_code.co_qualname))

    t_ns = stage.t_ns + stage.period_ns
    sys.settrace(of)
    try:
        stage.controller.cycle(t_ns, ON_TIME)
    finally:
        sys.settrace(None)
    assert stage.state == State.RUN
    return steps


def main() -> None:
    """Print the way, the files and the depth."""
    steps = trace()
    for step in steps:
        print(f"{'  ' * step.depth}{step.function}  ({step.file})")
    files = sorted({step.file for step in steps})
    print(*files, sep="\n")
    print(f"{len(files)} files, depth {max(step.depth for step in steps)}")


if __name__ == "__main__":
    main()
