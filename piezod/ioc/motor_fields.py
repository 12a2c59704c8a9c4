"""The fields of the record of an axis: those of a motor record that screens and scans use."""

from typing import Final, NamedTuple

TYPE_NAME: Final = "motor"
"""Name of the record type, which clients read in the field RTYP."""
DOUBLE, SHORT, STRING, MENU = "DBF_DOUBLE", "DBF_SHORT", "DBF_STRING", "DBF_MENU"
STRING_BYTES: Final = 16
SIZES: Final = {DOUBLE: 8, SHORT: 2, STRING: STRING_BYTES, MENU: 2}
"""Size of a field in the memory of a record, in bytes."""


class Field(NamedTuple):
    """One field.

    Attributes:
        name: Name.
        kind: Type in EPICS.
        what: Description for people.
        start: Value when the IOC starts.
        put: Whether clients write it.
        menu: Texts of a menu.
    """

    name: str
    kind: str
    what: str
    start: float | str = 0
    put: bool = False
    menu: tuple[str, ...] = ()


FIELDS: Final = (
    Field("VAL", DOUBLE, "Target; a write moves the axis", put=True),
    Field("RBV", DOUBLE, "Measured position; without a sensor, the command"),
    Field("DVAL", DOUBLE, "As VAL"),
    Field("DRBV", DOUBLE, "As RBV"),
    Field("DMOV", SHORT, "1: no movement goes on", 1),
    Field("MOVN", SHORT, "1: a movement goes on"),
    Field("STOP", SHORT, "A write of 1 stops the stage at its position", put=True),
    Field("TWV", DOUBLE, "Size of a tweak", 0.1, put=True),
    Field("TWF", SHORT, "A write of 1 moves by TWV forwards", put=True),
    Field("TWR", SHORT, "A write of 1 moves by TWV backwards", put=True),
    Field("HLM", DOUBLE, "Highest position"),
    Field("LLM", DOUBLE, "Lowest position"),
    Field("DHLM", DOUBLE, "As HLM"),
    Field("DLLM", DOUBLE, "As LLM"),
    Field("LVIO", SHORT, "1: the last write was beyond the limits"),
    Field("VELO", DOUBLE, "Speed of movements", 0, put=True),
    Field("VMAX", DOUBLE, "Highest speed"),
    Field("EGU", STRING, "Unit", "um"),
    Field("PREC", SHORT, "Digits after the decimal point", 4),
    Field("RDBD", DOUBLE, "Tolerance of `on_target`"),
    Field("ACCL", DOUBLE, "Always 0: piezod has no acceleration"),
    Field("MRES", DOUBLE, "Always 0.001", 0.001),
    Field("OFF", DOUBLE, "Always 0: user and dial positions are the same"),
    Field("DIR", MENU, "Always Pos", menu=("Pos", "Neg")),
    Field("FOFF", MENU, "Always Frozen", 1, menu=("Variable", "Frozen")),
    Field("SET", MENU, "Always Use", menu=("Use", "Set")),
    Field("HLS", SHORT, "Always 0: there is no limit switch"),
    Field("LLS", SHORT, "Always 0: there is no limit switch"),
    Field("TDIR", SHORT, "1: the target is above the position"),
    Field("HOMF", SHORT, "Always 0: there is no home switch"),
    Field("HOMR", SHORT, "Always 0: there is no home switch"),
)


def definition() -> str:
    """Return the definition of the record type, for EPICS (a DBD file)."""
    menus, fields = [], []
    for field in FIELDS:
        options = [f'prompt("{field.what}")', "asl(ASL0)", "special(SPC_MOD)"]
        if field.put:
            options.append("pp(TRUE)")  # a write with completion waits for the end of the movement
        if field.kind == STRING:
            options.append(f"size({STRING_BYTES})")
        if field.menu:
            menu = f"{TYPE_NAME}{field.name}"
            choices = (f'choice({menu}_{each}, "{each}")' for each in field.menu)
            menus.append(f"menu({menu}) {{ {' '.join(choices)} }}")
            options.append(f"menu({menu})")
        fields.append(f"  field({field.name}, {field.kind}) {{ {' '.join(options)} }}")
    body = ['  include "dbCommon.dbd"', *fields]
    return "\n".join([*menus, f"recordtype({TYPE_NAME}) {{", *body, "}", ""])
