"""How results look in a notebook."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Final, Protocol

_HEADINGS: Final = (
    "axis", "position/µm", "command/µm", "error/µm", "drive/V", "on target",
)  # fmt: skip


class ShownAxis(Protocol):
    """What a notebook shows of an axis; None is unknown."""

    @property
    def position_um(self) -> float | None: ...  # noqa: D102 - as in `AxisStatus`
    @property
    def command_um(self) -> float | None: ...  # noqa: D102
    @property
    def error_um(self) -> float | None: ...  # noqa: D102
    @property
    def drive_v(self) -> float | None: ...  # noqa: D102
    @property
    def on_target(self) -> bool: ...  # noqa: D102


class ShownFault(Protocol):
    """What a notebook shows of a fault."""

    @property
    def id(self) -> str: ...  # noqa: D102 - as in `Fault`
    @property
    def name(self) -> str: ...  # noqa: D102


class StatusTable:
    """Shows a status in notebooks: a line on the stage, and a table of its axes."""

    stage: str
    state: str
    mode: str
    shadow: bool
    faults: Sequence[ShownFault]
    axes: Mapping[str, ShownAxis]

    def _repr_html_(self) -> str:
        faults = ", ".join(f"{each.id} {each.name}".strip() for each in self.faults) or "none"
        shadow = ", shadow mode" if self.shadow else ""
        line = f"{self.stage or 'stage'}: {self.state}, mode {self.mode}{shadow}; faults: {faults}"
        head = "".join(f"<th>{each}</th>" for each in _HEADINGS)
        rows = "".join(f"<tr>{_row(name, axis)}</tr>" for name, axis in self.axes.items())
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        return f"<p>{escape(line)}</p>{table}"


def _row(name: str, axis: ShownAxis) -> str:
    values = (axis.position_um, axis.command_um, axis.error_um, axis.drive_v)
    numbers = ("–" if value is None else f"{value:.3f}" for value in values)
    cells = (escape(name), *numbers, "yes" if axis.on_target else "no")
    return "".join(f"<td>{cell}</td>" for cell in cells)
