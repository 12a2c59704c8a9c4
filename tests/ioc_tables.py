"""The tables of docs/ioc.md, from the declarations of the records: `python -m tests.ioc_tables`.

A test compares them with what is in the page.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import Final

from piezod.ioc.motor_fields import FIELDS, Field
from piezod.ioc.table import AXIS, STAGE, Record

PAGE: Final = Path(__file__).parents[1] / "docs" / "ioc.md"
BEGIN: Final = "<!-- {}: made by `python -m tests.ioc_tables`, begin -->\n"
END: Final = "<!-- end -->\n"


def page() -> str:
    """Return the page with its tables written anew."""
    text = PAGE.read_text(encoding="utf-8")
    tables = {
        "motor": field_table(),
        "fixed": fixed_table(),
        "axis": record_table(AXIS),
        "stage": record_table(STAGE),
    }
    for name, lines in tables.items():
        before, begin, rest = text.partition(BEGIN.format(name))
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise ValueError(f"{PAGE} has no marks for the table {name}")
        text = "".join((before, begin, *(f"{line}\n" for line in lines), end, after))
    return text


def record_table(records: Sequence[Record]) -> Iterator[str]:
    """Yield the lines of a table of records."""
    yield "| record | type | unit | contents | lists |"
    yield "|---|---|---|---|---|"
    for each in records:
        lists = ["archiver"] * each.archive + ["autosave"] * each.saved
        written = "; write it" if each.kind.is_set else ""
        yield (
            f"| `{each.name}` | {each.kind.value.removesuffix(', set')}{written} | {each.unit} | "
            f"{each.what}{_details(each)} | {', '.join(lists)} |"
        )


def field_table() -> Iterator[str]:
    """Yield the lines of the table of the fields of a motor record."""
    yield "| field | type | contents |"
    yield "|---|---|---|"
    for each in FIELDS:
        if not each.fixed:
            kind = _kind(each) + "; write it" * each.put
            yield f"| `{each.name}` | {kind} | {each.what} |"


def fixed_table() -> Iterator[str]:
    """Yield the lines of a table of the fixed fields, one for each value and reason."""
    yield "| fields | type | value | reason |"
    yield "|---|---|---|---|"
    fixed = [each for each in FIELDS if each.fixed]
    for (what, kind, value), fields in groupby(
        fixed, lambda each: (each.what, _kind(each), _value(each))
    ):
        names = ", ".join(f"`{each.name}`" for each in fields)
        yield f"| {names} | {kind} | {value} | {what} |"


def _kind(field: Field) -> str:
    return field.kind.removeprefix("DBF_").lower()


def _value(field: Field) -> str:
    """Return the value of a field that is fixed."""
    if isinstance(field.start, str):
        return field.start or "empty"
    return field.menu[int(field.start)] if field.menu else f"{field.start:g}"


def _details(record: Record) -> str:
    """Return choices, range and length, in brackets."""
    parts = []
    if record.choices and record.choices != ("no", "yes"):
        parts.append(", ".join(f"{i} {each}" for i, each in enumerate(record.choices)))
    if isfinite(record.low):
        parts.append(f"{record.low:g} to {record.high:g}")
    if record.length:
        parts.append(f"at most {record.length} elements")
    return f" ({'; '.join(parts)})" if parts else ""


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
