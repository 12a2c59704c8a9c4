"""Tests that the loop compiles nothing after its start."""

from collections.abc import Callable
from typing import Any

from piezod.config.modes import Mode
from piezod.control.law import step as stops
from piezod.control.law import surface_step as surfaces
from piezod.control.warm_up import warm_up
from piezod.hysteresis import everett_memory, loop_drives, rls_kernel, surface_rls_kernel
from piezod.messages import requests as rq
from tests.control.rig_stage import RigStage, shipped_config
from tests.control.surface_rig import surface_file

KERNELS: tuple[Callable[..., Any], ...] = (
    stops.step,
    surfaces.step,
    rls_kernel.step,
    surface_rls_kernel.step,
    surface_rls_kernel.predicted_drive,
    loop_drives._fill_stop_drives,  # noqa: SLF001 - the kernel that a cycle calls
    everett_memory.invert_record,
)


def compiled() -> list[int]:
    """Return how many versions of each kernel are compiled."""
    return [len(kernel.signatures) for kernel in KERNELS]  # type: ignore[attr-defined]


def test_a_surface_is_adopted_without_compiling() -> None:
    """A stage that started with stops may adopt a surface: a compiler would stall its loop."""
    warm_up(shipped_config())
    before = compiled()
    stage = RigStage(shipped_config())
    stage.until("SAFE")
    assert stage.ask(rq.AdoptModel(axis="x", model=surface_file())).accepted
    stage.do(rq.Arm(), rq.SelectMode(mode=Mode.ADAPTIVE), rq.Goto(position_um=9.0))
    stage.run(0.3)

    assert all(before)
    assert compiled() == before
