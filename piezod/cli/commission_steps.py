"""The steps of a first contact as a person sees them: each is told, confirmed, then done."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from piezod.commission.procedure import ProcedureStep
    from piezod.commission.session import Session


def walk(
    session: "Session",
    steps: "Iterator[ProcedureStep]",
    not_done: list[str],
    *,
    asking: bool,
    of: str = "",
    err: bool = True,
) -> None:
    """Do the steps until one is declined.

    Args:
        session: The axis.
        steps: What is to be done.
        not_done: Gets the names of the steps that are not, whatever ends this.
        asking: Whether each is to be confirmed.
        of: What the texts begin with.
        err: Whether what was found is told on stderr, as progress is; else on stdout.

    Raises:
        DeviceError: If the devices say that something is wrong.
    """
    for step in steps:
        done = False
        try:
            if asking and not _confirmed(step, session, of):
                return
            typer.echo(f"{of}{step.name}: {step.run()}", err=err)
            done = True
        finally:
            if not done:
                not_done += [step.name, *(later.name for later in steps)]


def _confirmed(step: "ProcedureStep", session: "Session", of: str) -> bool:
    with session.holding():
        return typer.confirm(f"{of}{step.name}: {step.what}?", default=not step.moves, err=True)
