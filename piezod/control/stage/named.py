"""Finds the axes that a request names."""

from collections.abc import Sequence

from piezod.control.stage.stage import Stage


def axes_named(stage: Stage, name: str | None) -> tuple[list[int], str]:
    """Return the indices of the named axes, all if the name is None; or why there are none."""
    names = [axis.name for axis in stage.axes]
    if name is None:
        return list(range(len(names))), ""
    if name not in names:
        return [], unknown_axis(stage, name)
    return [names.index(name)], ""


def unknown_axis(stage: Stage, name: str) -> str:
    """Return the refusal of a name that no axis has."""
    return f"no axis {name!r}; this stage has {axis_names(stage)}"


def axis_names(stage: Stage) -> str:
    """Return the names of all axes, as a text."""
    return ", ".join(axis.name for axis in stage.axes)


def without_sensor(stage: Stage, axes: Sequence[int], what: str) -> str:
    """Return the refusal of an activity that needs a sensor; empty if all these axes have one."""
    blind = [stage.axes[i].name for i in axes if not stage.axes[i].has_sensor]
    if not blind:
        return ""
    remedy = "configure one, borrowed if need be, or name another axis"
    return f"{what} needs a sensor, and axis {', '.join(blind)} has none: {remedy}"
