"""A field of status or telemetry appears where its description says, in every adapter."""

from dataclasses import dataclass
from typing import Annotated

import pytest
from rich.console import Console

from piezod.cli.look.status import axes_table
from piezod.ioc import values
from piezod.ioc.readings import UNKNOWN, Reading
from piezod.ioc.records import Names
from piezod.ioc.table import AXIS_RECORDS, STAGE_RECORDS, Kind, Record
from piezod.messages import answers
from piezod.messages.answers import AXIS, STAGE, AxisStatus, Status
from piezod.messages.shown import COLUMN, DETAIL, NEEDED, Shown, ShownField, shown_fields
from piezod.messages.telemetry import AxisTelemetry


@dataclass(frozen=True, kw_only=True)
class NewAxisStatus(AxisStatus):
    """The status of a newer version, with one more field."""

    #: How far the stage has crept, in µm.
    creep_um: Annotated[
        float | None, Shown("creep", "CREEP", "Creep since arming", COLUMN | DETAIL | NEEDED)
    ] = None


FIELDS = shown_fields(AxisTelemetry, NewAxisStatus)
CREEP = FIELDS["creep_um"]


def test_new_field_is_a_record() -> None:
    """The IOC has a number with the unit of the name, and shows it from the status."""
    record = Record.of_field(CREEP)

    assert (record.name, record.kind, record.unit) == ("CREEP", Kind.NUMBER, "um")


def test_record_of_a_new_field_has_its_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """The value comes from the status alone, and what telemetry has, too, is left to telemetry."""
    monkeypatch.setattr(values, "AXIS", FIELDS)

    known = values.of_axis(NewAxisStatus(position_um=1.0, creep_um=0.25), has_sensor=True)
    unknown = values.of_axis(NewAxisStatus(), has_sensor=True)

    assert known == {"CREEP": Reading(0.25)}
    assert unknown["CREEP"].alarm == UNKNOWN


def test_new_field_is_a_column(monkeypatch: pytest.MonkeyPatch) -> None:
    """`piezod status` and a notebook have a column with words, unit and value."""
    columns = [each for each in FIELDS.values() if each.has(COLUMN)]
    monkeypatch.setattr(answers, "COLUMNS", columns)
    found = Status(
        state="RUN", mode="adaptive", faults=(), skipped_cycles=0,
        axes={"x": NewAxisStatus(creep_um=0.25)},
    )  # fmt: skip
    console = Console(width=200)
    with console.capture() as printed:
        console.print(axes_table(found))

    for text in (printed.get(), found._repr_html_()):
        assert "creep/µm" in text
        assert "0.250" in text


def test_new_field_is_a_detail_of_the_page() -> None:
    """The page gets its words, unit and digits."""
    words = {"words": "creep", "what": "Creep since arming"}
    assert CREEP.document == {**words, "unit": "µm", "digits": 3, "detail": True}


@pytest.mark.parametrize("field", [*AXIS.values(), *STAGE.values()], ids=lambda field: field.name)
def test_every_field_with_a_record_has_one(field: ShownField) -> None:
    """No description names a record that the IOC does not have."""
    records = {each.name for each in (*STAGE_RECORDS, *AXIS_RECORDS)}

    assert not field.shown.record or field.shown.record in records
    assert len(field.shown.what) <= 40


def test_live_fields_are_those_of_telemetry() -> None:
    """What both messages have is described once, and is shown from telemetry."""
    assert AXIS["position_um"].live
    assert not AXIS["read_back_v"].live
    assert not FIELDS["creep_um"].live
    assert Names("p:", ("x",)).of_axis("x", AXIS["position_um"].shown.record) == "p:x:POS"


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("position_um", 1.23456, "1.235"),
        ("drive_v", 60.0, "60.00"),
        ("on_target", True, "yes"),
        ("gate", "paused", "paused"),
        ("target_um", None, "–"),
    ],
)
def test_values_are_texts_for_people(name: str, value: object, text: str) -> None:
    """Numbers have the digits of their unit, and what is unknown is a dash."""
    assert AXIS[name].text(value) == text
