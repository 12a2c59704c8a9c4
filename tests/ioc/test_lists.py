"""The files for archiver, autosave and Phoebus."""

from pathlib import Path
from xml.etree import ElementTree

from piezod.ioc.lists import archiver_list, autosave_list, screen, write_files
from piezod.ioc.motor_fields import FIELDS
from piezod.ioc.records import Names

WIDGETS = {"label", "textupdate", "textentry", "combo", "action_button"}
"""Types of widgets that Phoebus has, as its sources name them."""
NAMES = Names("p:", ("x", "y"))


def test_archiver_stores_what_moves() -> None:
    """State, positions and targets are archived; tables, settings and commands are not."""
    names = archiver_list(NAMES).splitlines()

    assert {"p:STATE", "p:x:POS", "p:y:DRIVE", "p:x.VAL"} <= set(names)
    assert not {"p:ARM", "p:x:HIST:POS", "p:x:WAVE:LOW"} & set(names)


def test_autosave_stores_settings_and_no_commands() -> None:
    """Nothing that is restored moves the stage."""
    names = autosave_list(NAMES).splitlines()

    assert {"p:x:WAVE:LOW", "p:REC:LABEL", "p:y.VELO"} <= set(names)
    assert not {"p:x.VAL", "p:x:MODE", "p:LEASE", "p:ARM", "p:x:WAVE:START"} & set(names)


def test_screen_has_records_of_the_table() -> None:
    """Every record and field on the screen exists, without macros; buttons write 1 to their own."""
    fields = {f"{NAMES.motor(axis)}.{each.name}" for axis in NAMES.axes for each in FIELDS}
    known = {name for name, _ in NAMES.all()} | fields
    text = screen(NAMES, "bench <1>")
    display = ElementTree.fromstring(text)  # noqa: S314 - made here
    shown = {each.text or "" for each in display.iter("pv_name")}
    buttons = display.findall("./widget[@type='action_button']")

    assert {"p:STATE", "p:x.RBV", "p:y:HIST:POS", "p:ESTOP"} <= shown
    assert shown <= known
    assert "$(" not in text
    assert {each.get("type") for each in display.iter("widget")} == WIDGETS
    for place in ("x", "y", "width", "height"):
        assert all(int(each.findtext(place) or -1) >= 0 for each in display.iter("widget"))
    assert display.findtext("name") == "bench <1>"
    for button in buttons:
        assert button.findtext("pv_name") == button.findtext("./actions/action/pv_name")
        assert button.findtext("./actions/action/value") == "1"


def test_files(tmp_path: Path) -> None:
    """Each stage has three files."""
    written = write_files(tmp_path / "new", "bench", NAMES, "Bench")

    assert [file.name for file in written] == ["bench.archive", "bench.req", "bench.bob"]
    assert all(file.stat().st_size for file in written)
