"""Files for other programs: what to archive, what to save, and a screen for Phoebus."""

from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from piezod.ioc.records import Names
from piezod.ioc.table import AXIS_RECORDS, STAGE_RECORDS, Kind, Record

_ROW, _LABEL, _VALUE, _COLUMN, _EDGE = 28, 190, 200, 440, 20
"""Sizes on the screen, in pixels."""
_FIELDS: Final = ("VAL", "RBV", "DMOV", "VELO", "TWV", "HLM", "LLM")
"""Fields of a motor record on the screen."""
_SAVED_FIELDS: Final = ("VELO", "TWV")


def archiver_list(names: Names) -> str:
    """Return the names for an archiver, one per line."""
    motors = [f"{names.motor(axis)}.VAL" for axis in names.axes]
    return _lines([name for name, record in names.all() if record.archive] + motors)


def autosave_list(names: Names) -> str:
    """Return the names for autosave, a request file: settings that only the IOC has."""
    fields = [f"{names.motor(axis)}.{field}" for axis in names.axes for field in _SAVED_FIELDS]
    return _lines([name for name, record in names.all() if record.saved] + fields)


def screen(names: Names, title: str) -> str:
    """Return a screen for Phoebus (BOB): a column for the stage, and one for each axis."""
    display = ElementTree.Element("display", version="2.0.0")
    _texts(display, name=title)
    stage = [(f"{names.prefix}{each.name}", each) for each in STAGE_RECORDS]
    _column(display, _EDGE, title, stage)
    for i, axis in enumerate(names.axes, 1):
        fields = [
            (f"{names.motor(axis)}.{name}", Record(name, _kind(name), name)) for name in _FIELDS
        ]
        rows = [(names.of_axis(axis, each.name), each) for each in AXIS_RECORDS if _is_shown(each)]
        _column(display, _EDGE + i * _COLUMN, axis, fields + rows)
    ElementTree.indent(display)
    return ElementTree.tostring(display, encoding="unicode", xml_declaration=True) + "\n"


def write_files(folder: Path, stage: str, names: Names, title: str) -> list[Path]:
    """Write all files of a stage; return their paths.

    Raises:
        OSError: If one cannot be written.
    """
    texts = {
        f"{stage}.archive": archiver_list(names),
        f"{stage}.req": autosave_list(names),
        f"{stage}.bob": screen(names, title),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def _lines(names: list[str]) -> str:
    return "".join(f"{name}\n" for name in names)


def _kind(field: str) -> Kind:
    return Kind.SET_NUMBER if field in {"VAL", "VELO", "TWV"} else Kind.NUMBER


def _is_shown(record: Record) -> bool:
    """Return whether the screen has a widget for a record; tables have none."""
    return record.kind not in {Kind.ARRAY, Kind.SET_ARRAY} or record.name.startswith("HIST:")


def _column(
    display: ElementTree.Element, x: int, title: str, rows: list[tuple[str, Record]]
) -> None:
    """Add a title and one row for each record."""
    _widget(display, "label", (x, _EDGE, _COLUMN - _EDGE, _ROW), text=title)
    for i, (name, record) in enumerate(rows, 1):
        y = _EDGE + i * _ROW
        _widget(display, "label", (x, y, _LABEL, _ROW - 4), text=record.what)
        place = (x + _LABEL, y, _VALUE, _ROW - 4)
        if record.kind is Kind.COMMAND:
            _button(display, place, name, record.name)
        else:
            _widget(display, _WIDGETS.get(record.kind, "textupdate"), place, pv_name=name)


_WIDGETS: Final = {
    Kind.SET_NUMBER: "textentry",
    Kind.SET_COUNT: "textentry",
    Kind.SET_TEXT: "textentry",
    Kind.SET_CHOICE: "combo",
}


def _widget(
    parent: ElementTree.Element, kind: str, place: tuple[int, int, int, int], **texts: str
) -> ElementTree.Element:
    widget = ElementTree.SubElement(parent, "widget", type=kind, version="2.0.0")
    sizes = dict(zip(("x", "y", "width", "height"), map(str, place), strict=True))
    _texts(widget, name=texts.get("pv_name", kind), **sizes, **texts)
    return widget


def _button(
    display: ElementTree.Element, place: tuple[int, int, int, int], name: str, text: str
) -> None:
    """Add a button that writes 1."""
    widget = _widget(display, "action_button", place, pv_name=name, text=text)
    actions = ElementTree.SubElement(widget, "actions")
    action = ElementTree.SubElement(actions, "action", type="write_pv")
    _texts(action, pv_name=name, value="1", description=text)


def _texts(parent: ElementTree.Element, **texts: str) -> None:
    for tag, text in texts.items():
        ElementTree.SubElement(parent, tag).text = text
