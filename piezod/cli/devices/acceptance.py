"""`piezod acceptance`: a signed record of what was tried with a device on the bench."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import ConfigArgument


def acceptance(
    config: ConfigArgument,
    by: Annotated[str, typer.Option("--by", metavar="NAME", help="Who has tried it.")],
    key: Annotated[
        Path,
        typer.Option(
            "--key", metavar="FILE", help="Private key of SSH that signs, as ~/.ssh/id_ed25519."
        ),
    ],
    device: Annotated[
        str | None,
        typer.Option("--device", metavar="NAME", help="Device; required if there are several."),
    ] = None,
    commissioned: Annotated[
        Path | None,
        typer.Option(
            "--commissioned",
            metavar="FILE",
            help="What `piezod commission --json` has printed about it.",
        ),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="TEXT",
            help="A fault that was tried, and what was seen: 'cable pulled: B1, BLIND'; may be "
            "repeated.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="The record. Default: DRIVER-MODEL.json."),
    ] = None,
) -> None:
    """Write a signed record of what was tried with a device; moves nothing.

    Inspects the device as `piezod probe` does, and measures the loop of this machine as `piezod
    check --machine` does. The signature is in a second file, with .sig at the end; `ssh-keygen -Y
    verify -n piezod` checks it. Send both files in an issue: they become evidence.
    """
    from piezod.cli.devices import acceptance_run

    path = acceptance_run.run(
        config, device, by=by, key=key, commissioned=commissioned, faults=fault or [], out=out
    )
    typer.echo(f"Record: {path}\nSignature: {path}.sig")
