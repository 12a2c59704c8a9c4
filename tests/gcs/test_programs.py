"""The requests of programs for PI controllers, in their order, as their sources send them."""

from collections.abc import Sequence

import pytest

from tests.gcs.fake_stage import Controller, Dialogue

MICRO_MANAGER = [
    # DeviceAdapters/PI_GCS_2, recorded from the adapter itself
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
    ("\x05", "1"),
    ("ERR?", "0"),
    ("MOV 1 99", ""),
    ("ERR?", "7"),
    ("FRF 1 ", ""),
    ("ERR?", "0"),
    ("\x07", "\xb1"),
    ("VEL 1 50", ""),
    ("ERR?", "0"),
    ("VEL? 1", "1=50.000000"),
    ("SVO? 1", "1=1"),
    ("STP", ""),
]
EPICS = [
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
PYLABLIB = [
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
PIPYTHON = [
    # the start of a device, and a move with its wait, after HLP?
    ("*IDN?", "(c)2026 piezod, piezod bench, 0, 1.2.3"),
    ("ERR?", "0"),
    ("CSV?", "2.0"),
    ("ERR?", "0"),
    ("SAI?", "1 \n2"),
    ("ERR?", "0"),
    ("ONL 1 1 2 1", ""),
    ("ERR?", "0"),
    ("\x18", ""),
    ("ERR?", "10"),
    ("\x07", "\xb1"),
    ("ERR?", "0"),
    ("FRF? 1", "1=1"),
    ("ERR?", "0"),
    ("SVO 1 1", ""),
    ("ERR?", "0"),
    ("\x07", "\xb1"),
    ("SVO 2 1", ""),
    ("ERR?", "0"),
    ("MOV 1 5", ""),
    ("ERR?", "0"),
    ("SVO? 1", "1=1"),
    ("ONT? 1", "1=0"),
    ("\x05", "1"),
    ("SPA? 1 117442049", "1 117442049=um"),
    ("\x18", ""),
    ("ERR?", "10"),
]


@pytest.mark.parametrize("exchanges", [MICRO_MANAGER, EPICS, PYLABLIB, PIPYTHON])
def test_program(
    controller: Controller, client: Dialogue, exchanges: Sequence[tuple[str, str]]
) -> None:
    """Each request has the reply that the program expects, and the program moves the stage."""
    for request, reply in exchanges:
        line = request if len(request) == 1 else f"{request}\n"
        replies = client.send(line.encode("latin-1")).decode("cp1252")
        assert (request, replies.removesuffix("\n")) == (request, reply)

    assert controller.stage.do("goto")[0]["axis"] == "x"
    assert controller.stage.paths()[-2:] == ["hold", "resume"]
