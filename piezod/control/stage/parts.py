"""The parts of a stage."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from piezod.config.model_file import ModelFile
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.boundary import DeviceBoundary
from piezod.control.stage.lines import StageLines
from piezod.control.stage.playing import PlayRunner
from piezod.control.stage.user_axes import UserAxes
from piezod.control.watch.axis import AxisWatch


class WatchedAxis(NamedTuple):
    """An axis with its watches."""

    axis: StageAxis
    watches: AxisWatch


Rebuild = Callable[[str, ModelFile, float], WatchedAxis]
"""Builds an axis again, from its name, a model and the voltage in force."""


class StageParts(NamedTuple):
    """The parts of a stage."""

    axes: Mapping[str, WatchedAxis]  #: The axes, by name.
    boundary: DeviceBoundary  #: The devices.
    period_ns: int  #: Period of the loop, in ns.
    rebuild: Rebuild  #: Builds an axis again with another model.
    plays: PlayRunner | None = None  #: Runs the plays of the devices; None if no device can play.
    lines: StageLines | None = None  #: The lines; None if there are none.
    #: Makes the user axes from the list of the axes, which may be replaced in it; None without.
    users: Callable[[Sequence[StageAxis]], UserAxes] | None = None
