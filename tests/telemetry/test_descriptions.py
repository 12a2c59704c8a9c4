"""Tests of the descriptions of the fields of a record."""

from piezod.config.faults import Fault
from piezod.telemetry.descriptions import descriptions, mask_bits
from piezod.telemetry.layout import AXIS_FIELDS, CYCLE_FIELDS


def test_every_field_is_described() -> None:
    """Each field of a record has a description, which is a sentence."""
    names = {field.name for field in (*CYCLE_FIELDS, *AXIS_FIELDS)}
    fields = {"seq", *(name for name in names if not name.startswith("_"))}

    assert descriptions().keys() == fields
    assert [text for text in descriptions().values() if not text.endswith(".")] == []


def test_continued_lines_belong_to_the_description() -> None:
    """A description has its unit and its special values, on one line."""
    assert descriptions()["position_um"] == (
        "Measured position, in µm; NaN if the sample may not be used."
    )


def test_bits_are_the_places_of_faults() -> None:
    """The bits of both halves of a mask are all faults, in their order."""
    bits = mask_bits()

    assert (*bits["present_lo"], *bits["present_hi"]) == tuple(Fault)
    assert bits["present_lo"].index(Fault.L2) == list(Fault).index(Fault.L2)
    assert (bits["latched_lo"], bits["latched_hi"]) == (bits["present_lo"], bits["present_hi"])
