"""User axes: several actuators as one stage in coordinates of the user."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.axes import AxisConfig
from piezod.config.coupling_file import CouplingFile, LoadedCoupling, Row
from piezod.config.document import KeyPath
from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.config.messages import show, suggest
from piezod.config.quantities import Name
from piezod.coordinates.frame import Frame, Lags, frame_of
from piezod.coordinates.matrices import Matrix, condition, from_rows, identity

WORST_CONDITION: Final = 100.0
"""A matrix beyond this would make errors of the sensors more than a hundred times larger."""
_UM_PER_MM_AND_URAD: Final = 1e-3

UserValue: TypeAlias = Annotated[float, Quantity(-100_000, 100_000)]


class UserAxisConfig(ConfigModel):
    """An axis of the user. Its numbers are in its unit."""

    unit: Literal["µm", "µrad"] = Field(default="µm", description="Unit of the axis.")
    range: tuple[UserValue, UserValue] = Field(description="Lowest and highest allowed command.")
    speed_per_s: Annotated[float, Quantity(1e-3, 1e6)] = Field(
        default=100.0, description="Highest speed on the way to a position, units/s."
    )
    tolerance: Annotated[float, Quantity(1e-6, 1000)] = Field(
        default=0.1, description="Largest error of a reached position."
    )
    settle_s: Annotated[float, Quantity(0, 60, "s")] = Field(
        default=0.05, description="Time for which the error must stay below it, s."
    )
    offset: UserValue = Field(
        default=0.0, description="Value of the axis where all actuators are at 0."
    )
    abbe_mm: dict[Name, Annotated[float, Quantity(-1000, 1000, "mm")]] = Field(
        default={},
        description="User axis in µrad: lever of the user's point, mm; 1 mm adds 0.001 µm/µrad.",
    )


class TransformConfig(ConfigModel):
    """User axes of a stage, and how its actuators make them."""

    axes: dict[Name, UserAxisConfig] = Field(
        min_length=1, max_length=16, description="Name: user axis."
    )
    actuators: dict[Name, Row] = Field(
        description="Axis: its displacement per unit of each user axis; 0 for those left out."
    )
    sensors: dict[Name, Row] | None = Field(
        default=None,
        description="User axis: its value per µm of the sensor of each axis; default: each sensor "
        "is at its actuator.",
    )
    coupling: LoadedCoupling | None = Field(
        default=None,
        description="Coupling file, made by `piezod identify --coupling`; default: the actuators "
        "do not move each other.",
    )

    def frame(self) -> Frame:
        """Return the matrices, of a transform that was accepted.

        Raises:
            ValueError: If one is singular.
        """
        if (found := self._frame()) is None:
            raise ValueError("a matrix is singular")
        return found

    @property
    def lags(self) -> Lags:
        """What moves each actuator later: index, share and lag in s of others; empty if nothing."""
        if self.coupling is None or not self.coupling.lags_s:
            return ()
        at, shares = list(self.actuators), self.coupling.shares
        rows = [self.coupling.lags_s.get(name, {}) for name in at]
        return tuple(
            tuple((at.index(other), shares[name][other], lag_s) for other, lag_s in row.items())
            for name, row in zip(at, rows, strict=True)
        )

    @property
    def contour_axes(self) -> tuple[str, ...]:
        """User axes that make a plane or a space: those in µm, or in µrad; none if too few are."""
        for unit in ("µm", "µrad"):
            found = tuple(name for name, axis in self.axes.items() if axis.unit == unit)
            if len(found) > 1:
                return found
        return ()

    def broken(self, axes: Mapping[str, AxisConfig]) -> Iterator[BrokenRule]:
        """Yield what does not fit the axes of the stage."""
        rules = [*self._broken_names(axes)]
        yield from rules or self._broken_matrices()
        for name in self.actuators.keys() & axes.keys():
            if axes[name].command_input is not None:
                what = f"not with `transform:`, {name} is moved by {', '.join(self.axes)}"
                yield ("axes", name, "command_input"), what

    def _frame(self) -> Frame | None:
        return frame_of(
            self._of_actuators(),
            self._of_sensors(),
            self._of_coupling(),
            self._levers(),
            [axis.offset for axis in self.axes.values()],
        )

    def _of_actuators(self) -> Matrix:
        return from_rows(self.actuators, tuple(self.actuators), tuple(self.axes))

    def _of_sensors(self) -> Matrix | None:
        if self.sensors is None:
            return None
        return from_rows(self.sensors, tuple(self.axes), tuple(self.actuators))

    def _of_coupling(self) -> Matrix:
        if self.coupling is None:
            return identity(len(self.actuators))
        rows = {name: {name: 1.0, **self.coupling.shares.get(name, {})} for name in self.actuators}
        return from_rows(rows, tuple(self.actuators), tuple(self.actuators))

    def _levers(self) -> Matrix:
        arms = {
            name: {name: 1.0, **{r: _UM_PER_MM_AND_URAD * mm for r, mm in axis.abbe_mm.items()}}
            for name, axis in self.axes.items()
        }
        return from_rows(arms, tuple(self.axes), tuple(self.axes))

    def _broken_names(self, axes: Mapping[str, AxisConfig]) -> Iterator[BrokenRule]:
        path: KeyPath = ("transform",)
        for name, axis in self.axes.items():
            here = (*path, "axes", name)
            if name in axes:
                yield here, "is the name of an axis already, name it otherwise"
            if not axis.range[0] < axis.range[1]:
                yield (*here, "range", 1), "must be above the first of the two"
            for lever in axis.abbe_mm:
                if lever == name or lever not in self.axes or self.axes[lever].unit != "µrad":
                    turning = [each for each, one in self.axes.items() if one.unit == "µrad"]
                    what = f"must be another user axis in µrad, {suggest(lever, turning, 'known')}"
                    yield (*here, "abbe_mm", lever), what
        yield from _broken_rows((*path, "actuators"), self.actuators, list(axes), list(self.axes))
        if (wanted := len(self.axes)) != len(self.actuators):
            what = f"needs one row for each user axis (got {len(self.actuators)} for {wanted})"
            yield (*path, "actuators"), what
        blind = [name for name in self.actuators if name in axes and axes[name].sensor is None]
        if blind:
            n = len(self.actuators)
            what = f"needs {n} sensors (got {n - len(blind)}), axis {', '.join(blind)} has none"
            yield (*path, "actuators", blind[0]), what
        if self.sensors is not None:
            known = list(self.axes), list(self.actuators)
            yield from _broken_rows((*path, "sensors"), self.sensors, *known)
            used = {sensor for row in self.sensors.values() for sensor in row}
            for kind, wanted_names, got in (
                ("a row for each user axis", self.axes.keys(), self.sensors.keys()),
                ("the sensor of each axis in `actuators`", self.actuators.keys(), used),
            ):
                if missing := sorted(wanted_names - got):
                    what = f"needs {kind} (got {len(got)}), {', '.join(missing)} is missing"
                    yield (*path, "sensors"), what
        if self.coupling is not None:
            yield from _broken_coupling(self.coupling, list(self.actuators))

    def _broken_matrices(self) -> Iterator[BrokenRule]:
        matrices: dict[str, Matrix | None] = {
            "actuators": self._of_actuators(),
            "sensors": self._of_sensors(),
            "coupling": self._of_coupling(),
        }
        for key, matrix in matrices.items():
            if matrix is not None and not (found := condition(matrix)) <= WORST_CONDITION:
                what = (
                    f"the rows hardly differ: it would make errors {found:.3g} times larger, "
                    f"allowed: at most {WORST_CONDITION:g}"
                )
                yield ("transform", key), what
        frame = self._frame()
        if frame is not None and not condition(frame.to_actuators) <= WORST_CONDITION:
            yield ("transform",), "the matrices together cannot be inverted"


def _broken_rows(
    path: KeyPath, rows: Mapping[str, Mapping[str, float]], names: list[str], columns: list[str]
) -> Iterator[BrokenRule]:
    for name, row in rows.items():
        for each, known, place in ((name, names, (name,)), *((c, columns, (name, c)) for c in row)):
            if each not in known:
                what = f"no such axis (got {show(each)}), {suggest(each, known, 'known')}"
                yield (*path, *place), what


def _broken_coupling(coupling: CouplingFile, actuators: list[str]) -> Iterator[BrokenRule]:
    named = {*coupling.shares, *(each for row in coupling.shares.values() for each in row)}
    if unknown := sorted(named - set(actuators)):
        what = (
            f"is of other axes (got {', '.join(unknown)}), `actuators` has {', '.join(actuators)}"
        )
        yield ("transform", "coupling"), what
