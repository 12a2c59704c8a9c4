"""Finds the axes that a request names."""

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
