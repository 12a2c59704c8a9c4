"""The process: it serves the records of its stages until a signal."""

import asyncio
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from ipaddress import IPv4Address
from pathlib import Path
from typing import Final, NamedTuple

from piezod.client import (
    AsyncStageClient,
    StageClient,
    request_bodies,  # noqa: F401 - slow; no command shall wait for it later
)
from piezod.errors import PiezodError
from piezod.ioc.lists import write_files
from piezod.ioc.records import Names
from piezod.ioc.stage import IocStage
from piezod.messages.answers import AxisStatus
from piezod.units import to_ascii

_LOOPBACK: Final = IPv4Address("127.0.0.1")
_LONGEST_NAME: Final = 60
_INSTALL: Final = "softioc is not installed: `pip install 'piezod[epics]'`"


class IocPlan(NamedTuple):
    """What to serve, and where."""

    sockets: Mapping[str, Path]  #: Sockets of the daemons, by the names of their stages.
    prefix: str  #: Begin of the names of the records; `{stage}` stands for the name of the stage.
    control: bool = False  #: Whether clients may write.
    #: Addresses of this machine to listen on; empty for loopback.
    interfaces: Sequence[IPv4Address] = ()


def serve(plan: IocPlan, announce: Callable[[str], None], report: Callable[[str], None]) -> None:
    """Serve stages until SIGINT or SIGTERM.

    Args:
        plan: What to serve.
        announce: Gets a line for each stage, when its records can be read.
        report: Gets the text of each refusal.

    Raises:
        PiezodError: If a daemon does not run, softioc is not installed, or a name is not possible.
    """
    os.environ.update(environment(plan.interfaces, os.environ))
    asyncio.run(_serve(plan, announce, report))


def environment(interfaces: Sequence[IPv4Address], environ: Mapping[str, str]) -> dict[str, str]:
    """Return the variables for EPICS: it listens on the interfaces, or on loopback only.

    Args:
        interfaces: Addresses of this machine; empty for those of the environment, or loopback.
        environ: The environment, whose variables stay if no interface is given.
    """
    addresses = " ".join(map(str, interfaces or (_LOOPBACK,)))
    variables = {"EPICS_CAS_INTF_ADDR_LIST": addresses, "EPICS_PVAS_INTF_ADDR_LIST": addresses}
    if not interfaces:
        variables |= {
            "EPICS_CAS_BEACON_ADDR_LIST": str(_LOOPBACK),
            "EPICS_CAS_AUTO_BEACON_ADDR_LIST": "NO",
            "EPICS_PVAS_BEACON_ADDR_LIST": str(_LOOPBACK),
            "EPICS_PVAS_AUTO_BEACON_ADDR_LIST": "NO",
        }
    kept = {} if interfaces else {name: environ[name] for name in variables if name in environ}
    return {**variables, **kept}


def names_of(prefix: str, stage: str, axes: Mapping[str, AxisStatus]) -> Names:
    """Return the names of the records of a stage.

    Raises:
        PiezodError: If a name is too long for EPICS.
    """
    units = {name: to_ascii(each.unit) for name, each in axes.items() if each.unit != "µm"}
    names = Names(prefix.replace("{stage}", stage), tuple(axes), units)
    longest = max((name for name, _ in names.all()), key=len)
    if len(longest) > _LONGEST_NAME:
        what = f"the name {longest} has {len(longest)} characters, EPICS allows {_LONGEST_NAME}"
        raise PiezodError(f"{what}: choose a shorter --prefix")
    return names


def _first(errors: Sequence[BaseException | None]) -> BaseException:
    """Return the first error, out of the group of a task group."""
    error = errors[0]
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error or PiezodError("the IOC has ended")


def write_lists(plan: IocPlan, folder: Path) -> list[Path]:
    """Write the files of `lists` for each stage; return their paths.

    Raises:
        PiezodError: If a daemon does not run, or a name is not possible.
        OSError: If a file cannot be written.
    """
    written = []
    for key, socket in plan.sockets.items():
        with StageClient(socket=socket, name="ioc") as client:
            status = client.status()
        names = names_of(plan.prefix, key, status.axes)
        written += write_files(folder, key, names, status.title or key)
    return written


async def _serve(
    plan: IocPlan, announce: Callable[[str], None], report: Callable[[str], None]
) -> None:
    ended = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    stages, found = {}, {}
    for key, socket in plan.sockets.items():
        async with AsyncStageClient(socket=socket, name="ioc") as client:
            found[key] = await client.status()
        stages[key] = IocStage(socket, names_of(plan.prefix, key, found[key].axes), report)
    try:
        from piezod.ioc.softioc_records import SoftIoc  # noqa: PLC0415 - needs the extra `epics`
    except ImportError as error:
        raise PiezodError(f"{_INSTALL} ({error})") from error
    ioc = SoftIoc(stages, control=plan.control)
    for key, stage in stages.items():
        stage.bind(ioc, ioc.motors[key], found[key])
    ioc.start()
    tasks = [asyncio.create_task(stage.run()) for stage in stages.values()]
    for stage in stages.values():
        announce(f"EPICS: {stage.names.prefix}STATE")
    until_signal = asyncio.create_task(ended.wait())
    await asyncio.wait((until_signal, *tasks), return_when=asyncio.FIRST_COMPLETED)
    failed = [task.exception() for task in tasks if task.done()]
    for task in (until_signal, *tasks):
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    if failed:
        raise _first(failed)
