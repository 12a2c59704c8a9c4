"""Which column of a file is time, drive or position, and how it becomes s, V or µm."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, NoReturn

from piezod.reading.checks import fail, shortened
from piezod.reading.choices import TIME, Choices, Role
from piezod.reading.table import Clock, Table
from piezod.reading.units import BASE, Unit, parts_of_name, unit_of

_PER_V: Final = "UM_PER_V"
_RATE: Final = "RATE"
_NAME: Final = "NAME"
_WHAT: Final = {
    "time": "the time",
    "voltage": "the drive voltage",
    "length": "the position",
}


class Chosen(NamedTuple):
    """A column of a file as a column of a record: factor times value plus offset."""

    role: Role  #: What it is.
    number: int  #: Its number among the columns of the table.
    factor: float  #: In s, V or µm per unit of the file.
    offset: float  #: In s, V or µm.
    said: str  #: What was understood, as a sentence; empty if its name says it all.


class _Known(NamedTuple):
    """A column, as its name and unit are understood."""

    name: str  #: As the file has it.
    stem: str  #: In small letters, without its unit.
    unit: Unit | None  #: Its unit; None if it is not known.


def chosen_columns(
    table: Table, roles: Sequence[Role], choices: Choices, command: str
) -> tuple[list[Chosen], Clock | None]:
    """Return the column of each role, and the time if no column has it.

    Args:
        table: The table.
        roles: What is needed.
        choices: What the person says.
        command: The command that needs it, for the remedy.

    Raises:
        DataError: If a role cannot be told; the text lists the columns, and has the command that
            would work.
    """
    known = [_known(table, number) for number in range(len(table.columns))]
    asked = _Asked(table, known, roles, choices, command)
    clock = _clock(table, choices)
    found: dict[str, int] = {}
    for role in roles:
        if role is TIME and choices.rate_hz is not None:
            continue
        numbers = asked.candidates(role)
        if role is TIME and not numbers and clock is not None:
            continue
        if len(numbers) != 1:
            asked.refuse(role, numbers, found)
        if numbers[0] in found.values():
            asked.refuse_twice(role, numbers[0])
        found[role.key] = numbers[0]
    chosen = [asked.converted(role, found[role.key], found) for role in roles if role.key in found]
    return chosen, None if TIME.key in found else clock


def quantity_of(table: Table, name: str) -> str:
    """Return the quantity of a column by its unit, "length" or "voltage"; "length" if unknown."""
    units = (_known(table, k).unit for k, each in enumerate(table.columns) if each.name == name)
    unit = next(units, None)
    return unit.quantity if unit and unit.quantity != TIME.quantity else "length"


def listed(table: Table) -> str:
    """Return the columns of a table with their units, for people."""
    texts = []
    for number, column in enumerate(table.columns):
        unit = _known(table, number).unit
        texts.append(f"{column.name!r} ({unit.text})" if unit else repr(column.name))
    return shortened(", ".join(texts))


def _known(table: Table, number: int) -> _Known:
    column = table.columns[number]
    stem, unit = parts_of_name(column.last or column.name)
    said = unit_of(column.unit)
    if unit and said and unit[1:] != said[1:]:
        what = f"{column.name!r} has {unit.text} in its name and {said.text} as its unit"
        fail(str(table.path), what, "allowed is one unit", "correct the file")
    return _Known(column.name, stem, said or unit or unit_of(column.name))


def _clock(table: Table, choices: Choices) -> Clock | None:
    if choices.rate_hz is not None:
        return Clock(0.0, 1.0 / choices.rate_hz, f"{choices.rate_hz:g} samples a second, as given")
    if table.clock is None or TIME.key not in choices.scale:
        return table.clock
    factor = choices.scale[TIME.key]
    said = f"{table.clock.said}, times {factor:g}"
    return Clock(factor * table.clock.start_s, factor * table.clock.interval_s, said)


class _Asked(NamedTuple):
    """What is needed of a table, and what the person says about it."""

    table: Table
    known: list[_Known]
    roles: Sequence[Role]
    choices: Choices
    command: str

    def candidates(self, role: Role) -> list[int]:
        """Return the columns that may be a role: one, if it can be told."""
        if role.key in self.choices.columns:
            return [self._named(self.choices.columns[role.key])]
        names = [each.name.strip().lower() for each in self.known]
        exact = [[k for k, name in enumerate(names) if name == wanted] for wanted in role.names]
        best = next(filter(None, exact), [])
        fit = [
            k
            for k, each in enumerate(self.known)
            if each.unit and each.unit.quantity == role.quantity
        ]
        by_name = [k for k in fit if self.known[k].stem in role.stems and k not in best]
        if role is TIME:
            best = best + by_name  # a second column of time is a doubt, whatever its name
        return best or by_name or fit

    def _named(self, wanted: str) -> int:
        for fold in (str.strip, lambda text: text.strip().lower()):
            found = [k for k, each in enumerate(self.known) if fold(each.name) == fold(wanted)]
            if len(found) == 1:
                return found[0]
            if found:
                what = f"column {wanted!r} appears {len(found)} times"
                fail(str(self.table.path), what, "allowed is once", "delete or rename one")
        if wanted.isdecimal() and 1 <= int(wanted) <= len(self.known):
            return int(wanted) - 1
        allowed = f"the file has {listed(self.table)}"
        remedy = "give one of them, or its number, with --columns"
        return fail(str(self.table.path), f"no column {wanted!r}", allowed, remedy)

    def converted(self, role: Role, number: int, found: Mapping[str, int]) -> Chosen:
        """Return a column with its factor and offset, and what was understood."""
        each, base = self.known[number], BASE[role.quantity]
        factor, given = 1.0, self.choices.scale.get(role.key)
        if each.unit:
            if each.unit.quantity != role.quantity and given is None:
                what = f"{each.name!r} is in {each.unit.text}, and {role.key} is in {base}"
                needed = f"--scale {role.key}={_PER_V if base == 'µm' else 'FACTOR'}"
                remedy = f"say how many {base} one {BASE[each.unit.quantity]} is, as in: "
                remedy += self._command({**found, role.key: number}, needed)
                fail(str(self.table.path), what, f"allowed is a unit of {role.quantity}", remedy)
            factor = each.unit.factor
        offset = self.choices.offset.get(role.key, 0.0)
        sign = -1.0 if role.key in self.choices.invert else 1.0
        changed = given is not None or offset != 0.0 or sign < 0.0
        said = self._said(role, each, (given or 1.0) * sign, offset, changed=changed)
        return Chosen(role, number, factor * (given or 1.0) * sign, offset, said)

    def _said(self, role: Role, each: _Known, scale: float, offset: float, *, changed: bool) -> str:
        if each.name.strip() == role.name and not changed:
            return ""
        times = f"{scale:.10g} · " if scale != 1.0 else ""
        plus = f" {offset:+.10g}" if offset else ""
        text = f"{role.name} = {times}{each.name!r}{plus}"
        if each.unit:
            base = BASE[each.unit.quantity]
            as_base = f" in {base}" if scale not in {1.0, -1.0} and each.unit.factor != 1.0 else ""
            return f"{text}{as_base}, which is in {each.unit.text}"
        base = BASE[role.quantity]
        if scale not in {1.0, -1.0}:
            return f"{text}, which has no known unit: {base} after the scale"
        return f"{text}, which has no known unit: taken as {base}"

    def refuse_twice(self, role: Role, number: int) -> NoReturn:
        """Raise the error about a column that another role has, too."""
        what = f"{self.known[number].name!r} is named twice, also as {_WHAT[role.quantity]}"
        allowed = "allowed is a column for each"
        remedy = f"the file has {listed(self.table)}; a name counts before a number"
        fail(str(self.table.path), what, allowed, remedy)

    def refuse(self, role: Role, numbers: list[int], found: Mapping[str, int]) -> NoReturn:
        """Raise the error about a role that cannot be told, with the command that would work."""
        guessed = self._guessed(role, numbers, found)
        if numbers:
            several = " and ".join(repr(self.known[k].name) for k in numbers)
            what = f"which column is {_WHAT[role.quantity]}? {several} may be it"
        else:
            what = (
                f"which column is {_WHAT[role.quantity]}? No column has a name and a unit "
                f"that say so, as {role.name} does"
            )
        allowed = f"the file has {listed(self.table)}"
        scale = ""
        for each in self.roles:
            unit = self.known[guessed[each.key]].unit if each.key in guessed else None
            if unit and unit.quantity != each.quantity and each.key not in self.choices.scale:
                scale = f"--scale {each.key}={_PER_V if each.quantity == 'length' else 'FACTOR'}"
        remedy = f"say it as in: {self._command(guessed, scale)}"
        remedy += f" ({self._hint(scale, guessed)})" if self._hint(scale, guessed) else ""
        fail(str(self.table.path), what, allowed, remedy)

    def _hint(self, scale: str, guessed: Mapping[str, int]) -> str:
        hints = []
        if _PER_V in scale:
            hints.append(
                f"{_PER_V}: µm per V of the sensor; if the drive is a monitor output, its gain, "
                "too, as drive=20"
            )
        if TIME in self.roles and TIME.key not in guessed and not _clock(self.table, self.choices):
            hints.append(f"{_RATE}: samples per second")
        if any(role.key not in guessed for role in self.roles if role is not TIME):
            hints.append(f"{_NAME}: a column of the file, which may have too few")
        return "; ".join(hints)

    def _guessed(self, asked: Role, numbers: list[int], found: Mapping[str, int]) -> dict[str, int]:
        """Return the likely column of each role, for the example."""
        guessed = dict(found)
        if numbers:
            guessed[asked.key] = numbers[0]
        by_rate = self.choices.rate_hz is not None or self.table.clock is not None
        open_roles = [role for role in self.roles if role.key not in guessed]
        for role in open_roles:
            if role is TIME and by_rate:
                continue
            certain = self.candidates(role)
            alike = certain or [
                k
                for k, each in enumerate(self.known)
                if each.stem in role.stems and not self._is_time(k)
            ]
            free = [k for k in alike if k not in guessed.values()]
            if free:
                guessed[role.key] = free[0]
        left = [k for k in range(len(self.known)) if k not in guessed.values()]
        left.sort(key=lambda k: self.known[k].unit is None)  # those without a unit may count rows
        rest = [role for role in self.roles if role.key not in guessed]
        if by_rate or len(left) < len(rest):
            rest = [role for role in rest if role is not TIME]
        for role in rest:
            free = [k for k in left if role is TIME or not self._is_time(k)]
            if free:
                guessed[role.key] = free[0]
                left.remove(free[0])
        return guessed

    def _is_time(self, number: int) -> bool:
        unit = self.known[number].unit
        return unit is not None and unit.quantity == TIME.quantity

    def _command(self, columns: Mapping[str, int], scale: str) -> str:
        pairs = []
        for role in self.roles:
            if role.key in columns:
                name = self.known[columns[role.key]].name
                plain = "," not in name and "=" not in name and self._is_only(name)
                pairs.append(f"{role.key}={name if plain else columns[role.key] + 1}")
            elif role is not TIME:
                pairs.append(f"{role.key}={_NAME}")
        words = ["piezod", *self.command.split(), str(self.table.path)]
        words += ["--columns", ",".join(pairs)]
        scales = [f"{key}={value:g}" for key, value in self.choices.scale.items()]
        if scale:
            scales.append(scale.removeprefix("--scale "))
        if scales:
            words += ["--scale", ",".join(scales)]
        if TIME in self.roles and TIME.key not in columns:
            if self.choices.rate_hz is not None:
                words += ["--rate-hz", f"{self.choices.rate_hz:g}"]
            elif self.table.clock is None:
                words += ["--rate-hz", _RATE]
        return shlex.join(words)

    def _is_only(self, name: str) -> bool:
        return sum(each.name == name for each in self.known) == 1
