"""`piezod drivers`: the installed drivers."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, new_table, print_json
from piezod.devices import plugins, registry
from piezod.devices.evidence import evidence_of
from piezod.errors import RegistryError


def drivers(json: JsonOption = False) -> None:
    """List the installed drivers, and what each of their profiles was checked against.

    A driver that cannot be loaded is listed with the reason. The words are: hardware (a signed
    record of `piezod acceptance`), capture (bytes of a real device), real firmware (on an emulated
    processor), kernel driver (of Linux), node and client (a device and a program by somebody else),
    manual, protocol (a program that does not know the device), none. With --json, `sees` lists the
    faults of docs/faults.md that it can detect.
    """
    found = [_look_up(name) for name in registry.names()]
    if json:
        print_json(
            {"drivers": [{**each._asdict(), "evidence": dict(each.evidence)} for each in found]}
        )
    else:
        _print_table(found)
        _print_evidence(found)


class _Driver(NamedTuple):
    name: str
    distribution: str
    summary: str | None = None
    confirmed_on_hardware: bool | None = None
    sees: tuple[str, ...] = ()
    evidence: Mapping[str, str] = MappingProxyType({})
    error: str | None = None


def _look_up(name: str) -> _Driver:
    points = plugins.points_of(registry.GROUP).select(name=name)
    made_by = sorted(f"{point.dist.name} {point.dist.version}" for point in points if point.dist)
    found = _Driver(name, ", ".join(made_by))
    try:
        plugin = registry.load(name)
    except RegistryError as error:
        return found._replace(error=str(error))
    confirmed = plugin.confirmed_on_hardware
    return found._replace(
        summary=plugin.summary,
        confirmed_on_hardware=confirmed,
        sees=tuple(sorted(plugin.sees, key=lambda id_: (id_[0], int(id_[1:])))),
        evidence=evidence_of(name),
    )


def _print_table(found: Sequence[_Driver]) -> None:
    table = new_table("driver", "devices", "confirmed\non hardware", "installed by")
    table.columns[0].no_wrap = True
    for each in found:
        confirmed = {True: "yes", False: "no", None: "?"}[each.confirmed_on_hardware]
        what = each.error or each.summary
        table.add_row(each.name, what, confirmed, each.distribution)
    new_console().print(table if found else "No driver is installed.")


def _print_evidence(found: Sequence[_Driver]) -> None:
    table = new_table("driver", "profile", "checked against", no_wrap=True)
    for each in found:
        for profile, word in each.evidence.items():
            table.add_row(each.name, profile, word)
    if table.row_count:
        new_console().print(table)
