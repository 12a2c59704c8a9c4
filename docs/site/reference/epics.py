"""The EPICS records, from their declarations."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from math import isfinite

from piezod.ioc.motor_fields import FIELDS, Field
from piezod.ioc.table import AXIS_RECORDS, FAULT_GROUPS, STAGE_RECORDS, Record


def page() -> Iterator[str]:
    """Yield the page."""
    yield "# EPICS records"
    yield ""
    yield "[EPICS](../ioc.md) explains them. Clients write ao, bo, mbbo, longout, stringout,"
    yield "and what says so."
    yield "\n## Fields of a motor record that follow the stage\n"
    yield from following_fields()
    yield "\n## Fields that keep a value\n"
    yield from fixed_fields()
    yield "\n## Records of an axis\n"
    yield from records_of(AXIS_RECORDS)
    yield "\n## Records of the stage\n"
    yield from records_of(STAGE_RECORDS)


def records_of(records: Sequence[Record]) -> Iterator[str]:
    """Yield a line for each record; those with the same contents share one."""
    for (kind, contents), same in groupby(records, lambda each: (_type(each), _contents(each))):
        yield f"- {_names(same)} ({kind}): {contents}"


def following_fields() -> Iterator[str]:
    """Yield the lines of the fields of a motor record that follow the stage."""
    following = [each for each in FIELDS if not each.fixed]
    for what, same in groupby(following, lambda each: each.what + "; write it" * each.put):
        yield f"- {_names(same)}: {what}"


def fixed_fields() -> Iterator[str]:
    """Yield a line for each value that fields keep."""
    fixed: dict[str, list[Field]] = {}
    for each in FIELDS:
        if each.fixed:
            fixed.setdefault(_value(each), []).append(each)
    for value, same in fixed.items():
        yield f"- {value}: {_names(same)}"


def _names(same: Iterable[Field | Record]) -> str:
    return ", ".join(f"`{each.name}`" for each in same)


def _value(field: Field) -> str:
    """Return the value of a field that is fixed."""
    if isinstance(field.start, str):
        return field.start or "empty"
    return field.menu[int(field.start)] if field.menu else f"{field.start:g}"


def _type(record: Record) -> str:
    return record.kind.value.replace(", set", "; write it")


def _contents(record: Record) -> str:
    """Return what a record has, with its unit, choices, range and length."""
    if record.name.partition(":")[2] in FAULT_GROUPS:
        return "Faults of this group"
    parts = [f"{record.what}, {record.unit}" if record.unit else record.what]
    if record.choices and record.choices != ("no", "yes"):
        parts.append(", ".join(f"{i} {each}" for i, each in enumerate(record.choices)))
    if isfinite(record.low):
        parts.append(f"{record.low:g} to {record.high:g}")
    if record.length:
        parts.append(f"at most {record.length}")
    return "; ".join(parts)
