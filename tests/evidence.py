"""Evidence that we did not write: `python -m tests.evidence` lists it per profile.

A test with the mark `confirms` checks a profile of a driver against somebody else's program, or
against facts of the maker. The command collects these marks from the source of the tests, writes
the section of `docs/measurements.md` for people, and one word per profile for `piezod drivers`. A
test compares both with the marks.
"""

import ast
import json
from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args

from docs.measured.tables import PAGE, filled, markdown
from piezod.devices import emulators, registry
from piezod.devices.evidence import FILE
from piezod_drivers.modbus.profiles import PROFILES as MODBUS_PROFILES

ROOT: Final = Path(__file__).parents[1]
WORDS: Final = ROOT / "drivers" / "piezod_drivers" / FILE
MARK: Final = "confirms"
KINDS: Final = {
    "hardware": "a device on a bench, by a signed record of `piezod acceptance`",
    "capture": "bytes that a real device has sent or received",
    "real firmware": "the compiled firmware of a device, on an emulated processor",
    "kernel driver": "a driver of the Linux kernel, in a virtual machine (`make vm`)",
    "node": "a device in software, by somebody else, with our driver",
    "client": "a program for the device, by somebody else, with our emulated device",
    "manual": "a table or an example of a manual or of public code, as data of a test",
    "protocol": "a program by somebody else that knows the protocol, but not the device",
}
"""The kinds of evidence, the strongest first."""
NONE: Final = "none"
DESCRIBED: Final = {"ascii", "can_dbc", "comedi", "iio"}
"""Drivers for any device, with a description of it in the configuration."""
WITHOUT_DEVICE: Final = {"simulated", "emulated", "piezo_board"}
"""Drivers of our own simulation and firmware: there is no device by others to be compared with."""
PAGES: Final = {
    "modbus": "modbus.md",
    "canopen": "can.md",
    "can_dbc": "can.md",
    "comedi": "daq-card.md",
    "iio": "raspberry-pi.md",
}
"""The page of each driver; the others are for serial devices."""
PEERS: Final = "tests/peers/"
GUEST: Final = "tests/vm/guest/"
"""Tests in these folders are run by `make peers` and `make vm`, the others by `make test`."""
RECORDS: Final = ROOT / "docs" / "hardware"
"""Folder for the records of `piezod acceptance`, each with its signature."""


class Evidence(NamedTuple):
    """A mark of a test."""

    driver: str  #: Name of the driver.
    profile: str  #: Name of the profile.
    part: str  #: The confirmed part of the profile.
    by: str  #: Somebody else's program, or the manual with its page.
    kind: str  #: One of `KINDS`.
    test: str  #: The test, as pytest names it, without parameters.


def main() -> None:
    """Write the section of the page, and the words."""
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), "evidence", evidence()), "utf-8")
    WORDS.write_text(words(marks()), encoding="utf-8")


def profiles() -> dict[str, tuple[str, ...]]:
    """Return the profiles of each driver: the device types of its options or of its emulators.

    A driver for devices that the configuration describes has one profile, which has its own name.
    """
    modules = {point.name: point.module for point in entry_points(group=emulators.GROUP)}
    found: dict[str, tuple[str, ...]] = {}
    for point in entry_points(group=registry.GROUP):
        package = point.module.rpartition(".")[0]
        if point.name in DESCRIBED:
            found[point.name] = (point.name,)
        elif point.name == "modbus":
            found[point.name] = (*MODBUS_PROFILES, "registers")
        elif point.name not in WITHOUT_DEVICE:
            emulated = sorted(name for name in modules if modules[name].startswith(f"{package}."))
            others = tuple(name for name in emulated if not name.endswith("-tcp"))
            found[point.name] = tuple(_choices(point.name)) or others
    return found


def _choices(driver: str) -> Iterator[str]:
    """Yield the device types that a configuration can name."""
    fields = registry.load(driver).options_model.model_fields
    for key in ("profile", "model"):
        if key in fields:
            yield from get_args(fields[key].annotation)


def marks() -> list[Evidence]:
    """Return records and marks of all tests, read from their source: nothing is imported."""
    found: list[Evidence] = list(records(RECORDS))
    files = [*(ROOT / "tests").rglob("test_*.py"), *(ROOT / GUEST).glob("*.py")]
    for file in sorted(files):
        text = file.read_text(encoding="utf-8")
        if f".{MARK}(" not in text:
            continue  # most files; parsing all of them takes seconds
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                test = f"{file.relative_to(ROOT).as_posix()}::{node.name}"
                for each in node.decorator_list:
                    found += _evidence_of(each, test)
    return sorted(found)


def records(folder: Path) -> Iterator[Evidence]:
    """Yield the evidence of the records of hardware in a folder."""
    for file in sorted(folder.glob("*.json")):
        record = json.loads(file.read_text(encoding="utf-8"))
        device = " ".join(part for part in record["device"]["identity"].values() if part)
        rows = record["commissioned"]["found"] if record["commissioned"] else []
        part = f"{device}: {len(rows)} results, {len(record['faults'])} faults"
        place = f"{file.relative_to(folder.parents[1]).as_posix()}::record"
        yield Evidence(record["driver"], record["profile"], part, record["by"], "hardware", place)


def _evidence_of(decorator: ast.expr, test: str) -> Iterator[Evidence]:
    """Yield the evidence of a decorator, if it is a mark; one mark may name several profiles."""
    if not (isinstance(decorator, ast.Call) and isinstance(decorator.func, ast.Attribute)):
        return
    if decorator.func.attr != MARK:
        return
    driver, names = (ast.literal_eval(each) for each in decorator.args)
    facts: dict[str, Any] = {
        str(each.arg): ast.literal_eval(each.value) for each in decorator.keywords
    }
    for profile in (names,) if isinstance(names, str) else names:
        yield Evidence(driver, profile, facts["part"], facts["by"], facts["kind"], test)


def word_of(found: list[Evidence], driver: str, profile: str) -> str:
    """Return the strongest kind of evidence of a profile."""
    kinds = {each.kind for each in found if (each.driver, each.profile) == (driver, profile)}
    return next((kind for kind in KINDS if kind in kinds), NONE)


def words(found: list[Evidence]) -> str:
    """Return the file with the word of each profile, by driver."""
    table: Mapping[str, object] = {
        driver: {profile: word_of(found, driver, profile) for profile in names}
        for driver, names in sorted(profiles().items())
    }
    return json.dumps(table, indent=2) + "\n"


def evidence() -> Iterator[str]:
    """Yield the section of the page: the words, and a table for each driver."""
    found = marks()
    meanings = [*KINDS.items(), (NONE, "nothing: only code of our own")]
    yield from markdown(("word", "what a test compares with"), meanings)
    for driver, names in sorted(profiles().items()):
        yield from ("", f"### [`{driver}`]({PAGES.get(driver, 'serial.md')})", "")
        rows = [row for name in names for row in _rows(found, driver, name)]
        yield from markdown(("profile", "word", "confirmed part", "by", "test"), rows)


def _rows(found: list[Evidence], driver: str, profile: str) -> list[tuple[str, ...]]:
    rows = [each for each in found if (each.driver, each.profile) == (driver, profile)]
    rows.sort(key=lambda each: list(KINDS).index(each.kind))
    return [(f"`{profile}`", row.kind, row.part, row.by, _link(row.test)) for row in rows] or [
        (f"`{profile}`", f"**{NONE}**", "nobody has confirmed anything", "", "")
    ]


def _link(test: str) -> str:
    path, _, name = test.partition("::")
    runs = {PEERS: " (`make peers`)", GUEST: " (`make vm`)"}
    target = next((text for folder, text in runs.items() if path.startswith(folder)), "")
    return f"[{name.removeprefix('test_').replace('_', ' ')}](../{path}){target}"


if __name__ == "__main__":
    main()
