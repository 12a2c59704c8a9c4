"""The records as they are declared, and their documentation."""

from piezod.ioc.motor_fields import FIELDS, definition, derived
from piezod.ioc.records import Names
from piezod.ioc.server import names_of
from piezod.ioc.table import AXIS_RECORDS, STAGE_RECORDS
from piezod.messages.answers import AxisStatus


def test_descriptions_fit() -> None:
    """EPICS keeps 40 characters of a description, 25 of a text of a choice, 15 of a unit."""
    for record in (*STAGE_RECORDS, *AXIS_RECORDS):
        assert len(record.what) <= 40, record.name
        assert all(len(choice) <= 25 for choice in record.choices), record.name
        assert len(record.unit) <= 15, record.name
        assert len(record.choices) <= 16, record.name


def test_names_differ() -> None:
    """No two records have the same name, for any name of an axis."""
    names = [name for name, _ in Names("p:", ("x", "y")).all()]

    assert len(names) == len(set(names)) == len(STAGE_RECORDS) + 2 * len(AXIS_RECORDS)
    assert all(record.name.isupper() for record in STAGE_RECORDS)


def test_prefix() -> None:
    """The name of the stage stands where the prefix says."""
    names = names_of("BL7:{stage}:", "bench", {"x": AxisStatus()})

    assert names.motor("x") == "BL7:bench:x"
    assert names.of_axis("x", "POS") == "BL7:bench:x:POS"


def test_definition_has_every_field() -> None:
    """Each field is in the definition for EPICS, once; others than those to write are fixed."""
    text = definition()

    for field in FIELDS:
        (line,) = (each for each in text.splitlines() if f"field({field.name}," in each)
        assert ("special(SPC_MOD)" if field.put else "special(SPC_NOMOD)") in line
    assert text.count("pp(TRUE)") == sum(field.put for field in FIELDS)


def test_fields_that_follow_from_others() -> None:
    """Dial, raw and status fields are those of target, position, limits and movement."""
    values = {field.name: field.start for field in FIELDS}
    now = derived({**values, "VAL": 5.0, "RBV": 4.5, "HLM": 26.0, "DMOV": 0, "MOVN": 1, "TDIR": 1})

    assert all(not field.fixed for field in FIELDS if field.name in now)
    assert now.keys() <= values.keys()
    assert (now["DVAL"], now["DRBV"], now["DIFF"], now["DHLM"]) == (5.0, 4.5, 0.5, 26.0)
    assert (now["RVAL"], now["RRBV"], now["RDIF"]) == (5000, 4500, 500)
    assert (now["MSTA"], now["MIP"]) == (0x401, 0x20)
