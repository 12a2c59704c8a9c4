"""Finds the axes that a request names."""

from collections.abc import Sequence

from piezod.control.stage.stage import Stage


def axes_named(stage: Stage, name: str | None) -> tuple[list[int], str]:
    """Return the indices of the named axes, all if the name is None; or why there are none."""
    names = [axis.name for axis in stage.axes]
    if stage.users is not None and name in stage.users.names:
        return [], f"{name} is a user axis: name one of {', '.join(names)}"
    if name is None:
        return list(range(len(names))), ""
    if name not in names:
        return [], unknown_axis(stage, name)
    return [names.index(name)], ""


def axes_behind(stage: Stage, name: str | None) -> tuple[list[int], str]:
    """Return the same; for a user axis those of all actuators, which move it together."""
    if stage.users is not None and name in stage.users.names:
        return stage.users.at, ""
    return axes_named(stage, name)


def unknown_axis(stage: Stage, name: str) -> str:
    """Return the refusal of a name that no axis has."""
    return f"no axis {name!r}; this stage has {axis_names(stage)}"


def axis_names(stage: Stage) -> str:
    """Return the names of all axes that can be named, as a text."""
    users = () if stage.users is None else stage.users.names
    return ", ".join([*users, *(axis.name for axis in stage.axes)])


def without_sensor(stage: Stage, axes: Sequence[int], what: str) -> str:
    """Return the refusal of an activity that needs a sensor; empty if all these axes have one."""
    blind = [stage.axes[i].name for i in axes if not stage.axes[i].has_sensor]
    if not blind:
        return ""
    remedy = "configure one, borrowed if need be, or name another axis"
    return f"{what} needs a sensor, and axis {', '.join(blind)} has none: {remedy}"
