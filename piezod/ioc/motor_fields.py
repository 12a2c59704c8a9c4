"""The fields of the record of an axis: those of a motor record that screens and scans use."""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Final, NamedTuple

from piezod.ioc.request_limits import range_of
from piezod.messages.requests import Goto

TYPE_NAME: Final = "motor"
"""Name of the record type, which clients read in the field RTYP."""
DOUBLE, SHORT, LONG = "DBF_DOUBLE", "DBF_SHORT", "DBF_LONG"
STRING, MENU = "DBF_STRING", "DBF_MENU"
STRING_BYTES: Final = 16
SIZES: Final = {DOUBLE: 8, SHORT: 2, LONG: 4, STRING: STRING_BYTES, MENU: 2}
"""Size of a field in the memory of a record, in bytes."""
STEP_UM: Final = 0.001
"""Step of the raw positions, in µm: a stage has none, but clients divide by it."""
GO: Final = 3
"""Value of SPMG that clients read."""
_DONE, _MOVING = 1 << 1, 1 << 10
"""Bits of MSTA."""
_MIP_MOVE: Final = 1 << 5
"""Bit of MIP."""


class Field(NamedTuple):
    """One field."""

    name: str  #: Name.
    kind: str  #: Type in EPICS.
    what: str  #: Description for people.
    start: float | str = 0  #: Value when the IOC starts.
    unit: str = ""  #: Unit.
    put: bool = False  #: Whether clients write it.
    menu: tuple[str, ...] = ()  #: Texts of a menu.
    fixed: bool = False  #: Whether it keeps the first value.

    def why_not(self, value: float) -> str:
        """Return why a value may not be written to this field, for any axis; empty if it may."""
        low, high = _POSITIONS_UM if self.kind == DOUBLE else (0, 1)
        if self.menu:
            high = len(self.menu) - 1
        if isfinite(value) and low <= value <= high:
            return ""
        return f"{value:g}, allowed range {low:g} to {high:g}"


def _fixed(
    names: str,
    kind: str,
    what: str,
    start: float | str = 0,
    unit: str = "",
    menu: tuple[str, ...] = (),
) -> Iterable[Field]:
    """Yield fields with the same value, which never changes."""
    for name in names.split():
        yield Field(name, kind, what, start, unit, menu=menu, fixed=True)


_POSITIONS_UM: Final = range_of(Goto, "position_um")
_NO_YES: Final = ("No", "Yes")
_SEVERITIES: Final = ("NO_ALARM", "MINOR", "MAJOR", "INVALID")
_UM_PER_S: Final = "um/s"

FIELDS: Final = (
    Field("VAL", DOUBLE, "Target; a write moves the axis", unit="um", put=True),
    Field("RBV", DOUBLE, "Measured position; without a sensor, the command", unit="um"),
    Field("DIFF", DOUBLE, "VAL minus RBV", unit="um"),
    Field("DMOV", SHORT, "1: no movement goes on", 1),
    Field("MOVN", SHORT, "1: a movement goes on"),
    Field("STOP", SHORT, "A write of 1 stops the stage at its position", put=True),
    Field(
        "SPMG",
        MENU,
        "Always Go; a write of Stop or Pause stops, as STOP does",
        GO,
        put=True,
        menu=("Stop", "Pause", "Move", "Go"),
    ),
    Field("TWV", DOUBLE, "Size of a tweak", 0.1, unit="um", put=True),
    Field("TWF", SHORT, "A write of 1 moves by TWV forwards", put=True),
    Field("TWR", SHORT, "A write of 1 moves by TWV backwards", put=True),
    Field("HLM", DOUBLE, "Highest position", unit="um"),
    Field("LLM", DOUBLE, "Lowest position", unit="um"),
    Field("LVIO", SHORT, "1: the last write was beyond the limits"),
    Field("VELO", DOUBLE, "Speed of movements", unit=_UM_PER_S, put=True),
    Field("VMAX", DOUBLE, "Highest speed", unit=_UM_PER_S),
    Field("ACCL", DOUBLE, "Time to reach VELO in the longest movement", unit="s"),
    Field("RDBD", DOUBLE, "Tolerance of `on_target`", unit="um"),
    Field("TDIR", SHORT, "1: the target is above the position"),
    Field("DVAL", DOUBLE, "As VAL", unit="um"),
    Field("LVAL", DOUBLE, "As VAL", unit="um"),
    Field("LDVL", DOUBLE, "As VAL", unit="um"),
    Field("DRBV", DOUBLE, "As RBV", unit="um"),
    Field("DHLM", DOUBLE, "As HLM", unit="um"),
    Field("HOPR", DOUBLE, "As HLM", unit="um"),
    Field("DLLM", DOUBLE, "As LLM", unit="um"),
    Field("LOPR", DOUBLE, "As LLM", unit="um"),
    Field("S", DOUBLE, "As VELO", unit="rev/s"),
    Field("SMAX", DOUBLE, "As VMAX", unit="rev/s"),
    Field("RVAL", LONG, "VAL in steps of MRES", unit="steps"),
    Field("LRVL", LONG, "VAL in steps of MRES", unit="steps"),
    Field("RRBV", LONG, "RBV in steps of MRES", unit="steps"),
    Field("RMP", LONG, "RBV in steps of MRES", unit="steps"),
    Field("REP", LONG, "RBV in steps of MRES", unit="steps"),
    Field("RDIF", LONG, "DIFF in steps of MRES", unit="steps"),
    Field("MSTA", LONG, "Bits: 1 done, 10 moving"),
    Field("MIP", SHORT, "Bit: 5 moving"),
    *_fixed("EGU", STRING, "unit", "um"),
    *_fixed("PREC", SHORT, "digits after the decimal point", 4),
    *_fixed("MRES ERES RRES", DOUBLE, "um per step", STEP_UM, "um"),
    *_fixed("SREV", LONG, "steps per revolution", round(1.0 / STEP_UM)),
    *_fixed("UREV", DOUBLE, "um per revolution", 1.0, "um"),
    *_fixed("OFF", DOUBLE, "user and dial positions are the same", 0, "um"),
    *_fixed("DIR", MENU, "user and dial positions are the same", menu=("Pos", "Neg")),
    *_fixed("FOFF", MENU, "the offset is fixed", 1, menu=("Variable", "Frozen")),
    *_fixed("SET", MENU, "a write to VAL moves", menu=("Use", "Set")),
    *_fixed("SSET SUSE", SHORT, "a write to VAL moves"),
    *_fixed("BACC JAR DLY", DOUBLE, "no backlash and no delay", 0, "s"),
    *_fixed("BDST", DOUBLE, "no backlash", 0, "um"),
    *_fixed("BVEL SBAK VBAS SBAS JVEL HVEL", DOUBLE, "no such speed", 0, _UM_PER_S),
    *_fixed("RVEL", LONG, "no such speed"),
    *_fixed("HLS LLS RHLS RLLS ATHM", SHORT, "no limit switch and no home switch"),
    *_fixed("HOMF HOMR JOGF JOGR SYNC", SHORT, "no homing, no jogging"),
    *_fixed("RLV LRLV", DOUBLE, "no relative movements", 0, "um"),
    *_fixed("RTRY RCNT MISS", SHORT, "no retries"),
    *_fixed("FRAC", DOUBLE, "the whole way at once", 1.0),
    *_fixed("PCOF ICOF DCOF", DOUBLE, "the gains are in the configuration"),
    *_fixed("CNEN", MENU, "the stage is armed with ARM", 1, menu=("Disable", "Enable")),
    *_fixed("LSPG", MENU, "as SPMG", GO, menu=("Stop", "Pause", "Move", "Go")),
    *_fixed("UEIP URIP", MENU, "no other source of RBV", menu=_NO_YES),
    *_fixed("NTM", MENU, "a new target is taken at once", 1, menu=_NO_YES),
    *_fixed("NTMF", SHORT, "a new target is taken at once"),
    *_fixed("OMSL", MENU, "clients write VAL", menu=("supervisory", "closed_loop")),
    *_fixed("STUP", MENU, "the status is always new", menu=("OFF", "ON", "BUSY")),
    *_fixed("HIHI HIGH LOW LOLO", DOUBLE, "no alarm limits", 0, "um"),
    *_fixed("HHSV HSV LSV LLSV HLSV", MENU, "no alarm limits", menu=_SEVERITIES),
    *_fixed("OUT RDBL PREM POST", STRING, "no links", ""),
    *_fixed("CARD", SHORT, "no card"),
    *_fixed("VERS", DOUBLE, "no version"),
)


def derived(values: Mapping[str, float | str]) -> dict[str, float]:
    """Return the fields that follow from others."""
    of = {name: value for name, value in values.items() if not isinstance(value, str)}
    target, position = of["VAL"], of["RBV"]
    target_steps, steps = round(target / STEP_UM), round(position / STEP_UM)
    done, moving = bool(of["DMOV"]), bool(of["MOVN"])
    return {
        **dict.fromkeys(("DVAL", "LVAL", "LDVL"), target),
        **dict.fromkeys(("RVAL", "LRVL"), target_steps),
        **dict.fromkeys(("RRBV", "RMP", "REP"), steps),
        **dict.fromkeys(("DHLM", "HOPR"), of["HLM"]),
        **dict.fromkeys(("DLLM", "LOPR"), of["LLM"]),
        "DRBV": position,
        "DIFF": target - position,
        "RDIF": target_steps - steps,
        "S": of["VELO"],
        "SMAX": of["VMAX"],
        "MSTA": of["TDIR"] + _DONE * done + _MOVING * moving,
        "MIP": _MIP_MOVE * moving,
    }


def definition() -> str:
    """Return the definition of the record type, for EPICS (a DBD file)."""
    menus, fields = [], []
    for field in FIELDS:
        options = [f'prompt("{field.what}")']
        if field.put:
            # Clients may write fields of level 0. A write with completion waits for the end of the
            # movement.
            options += ["asl(ASL0)", "special(SPC_MOD)", "pp(TRUE)"]
        else:
            options.append("special(SPC_NOMOD)")
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
