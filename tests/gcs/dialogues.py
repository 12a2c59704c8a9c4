"""The requests of programs for PI controllers, in their order, as their sources send them.

Beside each request is the reply of a stage with the axes x and y at 1.5 µm: empty for none, None
for any.
"""

from collections.abc import Mapping, Sequence
from typing import Final

Exchanges = Sequence[tuple[str, str | None]]

MOVING: Final = "\x05"
READY: Final = "\x07"
STOP_ALL: Final = "\x18"
MICRO_MANAGER: Final[Exchanges] = [
    # DeviceAdapters/PI_GCS_2, recorded from the adapter itself; `POS?` from its sources
    ("*IDN?", "(c)2026 piezod, piezod bench, 0, 1.2.3"),
    ("TPC?", "2"),
    ("ERR?", "0"),
    ("ERR?", "0"),
    ("ONL 1 1 2 1", ""),
    ("ERR?", "0"),
    ("JON? 1", ""),
    ("ERR?", "2"),
    ("EAX 1 1", ""),
    ("ERR?", "2"),
    ("SVO 1 1", ""),
    ("ERR?", "0"),
    ("HIN? 1", ""),
    ("ERR?", "2"),
    ("MOV 1 5", ""),
    ("ERR?", "0"),
    ("CSV?", "2.0"),
    ("ERR?", "0"),
    (MOVING, "1"),
    ("ERR?", "0"),
    ("POS? 1", "1=1.500000"),
    ("MOV 1 99", ""),
    ("ERR?", "7"),
    ("FRF 1 ", ""),
    ("ERR?", "0"),
    (READY, "\xb1"),
    ("VEL 1 50", ""),
    ("ERR?", "0"),
    ("VEL? 1", "1=50.000000"),
    ("SVO? 1", "1=1"),
    ("STP", ""),
]
EPICS: Final[Exchanges] = [
    # pigcs2App/src: PIasynController, PIGCSController, PIGCSPiezoController, PIasynAxis
    ("*IDN?", "(c)2026 piezod, piezod bench, 0, 1.2.3"),
    ("VEL?", "1=100.000000 \n2=100.000000"),
    ("SAI?", "1 \n2"),
    ("TRS? 1", "1=0"),
    ("FRF? 1", "1=1"),
    ("SVO 1 1", ""),
    ("ERR?", "0"),
    ("VEL? 1", "1=100.000000"),
    ("POS? 1", "1=1.500000"),
    ("TMN? 1", "1=0.000000"),
    ("TMX? 1", "1=20.000000"),
    ("FRF? 1", "1=1"),
    ("SRG? 1 1", "1 1=0x9000"),
    ("VEL 1 20.000000", ""),
    ("MOV 1 7.500000", ""),
    ("ERR?", "0"),
    ("SRG? 1 1", "1 1=0x3000"),
    ("STP", ""),
    ("ERR?", "10"),
    ("SRG? 1 1", "1 1=0x3000"),
]
PYLABLIB: Final[Exchanges] = [
    # pylablib/devices/PhysikInstrumente/base.py, PIE516, for both axes
    ("*IDN?", "(c)2026 piezod, piezod bench, 0, 1.2.3"),
    ("SVO 1 1 2 1", ""),
    ("SVO? 1 2", "1=1 \n2=1"),
    ("VEL 1 2.00000E+01", ""),
    ("VEL? 1", "1=20.000000"),
    ("MOV 1 5.00000E+00", ""),
    ("MOV? 1", "1=5.000000"),
    ("MVR 1 -5.00000E-01", ""),
    ("MOV? 1", "1=4.500000"),
    ("NLM? 1", "1=0.000000"),
    ("PLM? 1", "1=20.000000"),
    ("VOL? 1", "1=20.250000"),
    ("STP 1", ""),
    ("ERR?", "10"),
]
PIPYTHON: Final[Exchanges] = [
    # the start of a device, and a move with its wait
    ("HLP?", None),
    ("*IDN?", "(c)2026 piezod, piezod bench, 0, 1.2.3"),
    ("ERR?", "0"),
    ("CSV?", "2.0"),
    ("ERR?", "0"),
    ("SAI?", "1 \n2"),
    ("ERR?", "0"),
    ("ONL 1 1 2 1", ""),
    ("ERR?", "0"),
    (STOP_ALL, ""),
    ("ERR?", "10"),
    (READY, "\xb1"),
    ("ERR?", "0"),
    ("FRF? 1", "1=1"),
    ("ERR?", "0"),
    ("SVO 1 1", ""),
    ("ERR?", "0"),
    (READY, "\xb1"),
    ("SVO 2 1", ""),
    ("ERR?", "0"),
    ("MOV 1 5", ""),
    ("ERR?", "0"),
    ("SVO? 1", "1=1"),
    ("ONT? 1", "1=0"),
    (MOVING, "1"),
    ("SPA? 1 117442049", "1 117442049=um"),
    (STOP_ALL, ""),
    ("ERR?", "10"),
]
PROGRAMS: Final[Mapping[str, Exchanges]] = {
    "Micro-Manager, `PI_GCS_2`": MICRO_MANAGER,
    "EPICS, `motorPIGCS2`": EPICS,
    "pylablib, `PIE516`": PYLABLIB,
    "PIPython": PIPYTHON,
}
"""The dialogue of each program."""
