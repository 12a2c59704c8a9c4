"""The interface of the records, which softioc implements, and tests."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import NamedTuple, Protocol

from piezod.ioc.readings import Alarm, Reading
from piezod.ioc.table import AXIS_RECORDS, STAGE_RECORDS, Record


class Motor(Protocol):
    """The record of an axis, of the type `motor`."""

    def get(self, field: str) -> float:
        """Return the value of a field that is a number."""
        ...

    def set(self, alarm: Alarm | None = None, *, failed: bool = False, **values: float) -> None:
        """Change fields and alarm; None keeps the present alarm.

        Args:
            alarm: New alarm.
            failed: Whether the movement that ends with these values has failed.
            **values: New values of fields.
        """
        ...

    def locked(self) -> AbstractContextManager[None]:
        """Return a context manager that locks the record; a thread may lock it several times."""
        ...


class Records(Protocol):
    """All records, by their full names."""

    def set(self, name: str, reading: Reading) -> None:
        """Show a value."""
        ...

    def set_alarm(self, name: str, alarm: Alarm) -> None:
        """Change the alarm of a record that keeps its value."""
        ...

    def get(self, name: str) -> object:
        """Return the value of a record that clients write."""
        ...


class Names(NamedTuple):
    """The names of the records of one stage."""

    prefix: str  #: Begin of the names.
    axes: tuple[str, ...]  #: Names of the axes.
    units: Mapping[str, str] = {}  #: Units of user axes in another one than um, as `urad`.

    def motor(self, axis: str) -> str:
        """Return the name of the motor record of an axis."""
        return f"{self.prefix}{axis}"

    def of_axis(self, axis: str, name: str) -> str:
        """Return the full name of a record of `AXIS_RECORDS`."""
        return f"{self.prefix}{axis}:{name}"

    def all(self) -> list[tuple[str, Record]]:
        """Return the full names of all records, without the motor records."""
        stage = [(f"{self.prefix}{each.name}", each) for each in STAGE_RECORDS]
        axes = [
            (self.of_axis(axis, each.name), self._in_its_unit(axis, each))
            for axis in self.axes
            for each in AXIS_RECORDS
        ]
        return stage + axes

    def _in_its_unit(self, axis: str, record: Record) -> Record:
        unit = self.units.get(axis)
        if unit is None or not record.unit.startswith("um"):
            return record
        return record._replace(unit=record.unit.replace("um", unit, 1))
