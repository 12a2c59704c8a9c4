"""The steps of commissioning at the terminal: each is announced, confirmed, then done."""

from collections.abc import Iterator

import typer

from piezod.commission.procedure import ProcedureStep
from piezod.commission.session import Session


def walk(
    session: Session,
    steps: Iterator[ProcedureStep],
    not_done: list[str],
    *,
    asking: bool,
    prefix: str = "",
    err: bool = True,
) -> None:
    """Do the steps in order until the user declines one.

    Args:
        session: The axis.
        steps: The steps.
        not_done: Receives the names of the steps that were not done, also after an error.
        asking: Whether the user confirms each step.
        prefix: Beginning of every text.
        err: Whether results go to stderr, as progress does; otherwise to stdout.

    Raises:
        DeviceError: If a device reports an error.
        LatenessError: If the computer was too late for a step each time.
    """
    for step in steps:
        done = False
        try:
            if asking and not _confirmed(step, session, prefix):
                return
            typer.echo(f"{prefix}{step.name}: {step.run()}", err=err)
            done = True
        finally:
            if not done:
                not_done += [step.name, *(later.name for later in steps)]


def print_note(text: str) -> None:
    """Print a remark on a step to stderr."""
    typer.echo(text, err=True)


def _confirmed(step: ProcedureStep, session: Session, prefix: str) -> bool:
    # A device with a watchdog needs writes while the user thinks.
    with session.holding():
        return typer.confirm(f"{prefix}{step.name}: {step.what}?", default=not step.moves, err=True)
