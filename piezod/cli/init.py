"""`piezod init`: the example configurations, to begin with."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import JsonOption


def init(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="[DIR]", help="Folder for the files, made if absent.", show_default=True
        ),
    ] = Path("config"),
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite files that are there and differ.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Write the example configurations: stages, their models, experiments.

    Files of the same name that differ are left as they are; then nothing is written, they are
    listed, and the exit code is 1.
    """
    from piezod.cli.output import print_json
    from piezod.cli.shipped import shipped

    examples = {
        file.relative_to(shipped("config")): file.read_bytes()
        for file in sorted(shipped("config").rglob("*"))
        if file.is_file()
    }
    missing = [name for name in examples if not (folder / name).exists()]
    differ = [
        name
        for name, content in examples.items()
        if name not in missing and (folder / name).read_bytes() != content
    ]
    if differ and not force:
        _refuse([folder / name for name in differ])
    written = sorted([*missing, *differ])
    for name in written:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(examples[name])
    if json:
        print_json({"folder": str(folder), "written": [str(name) for name in written]})
    else:
        _tell(folder, written)


def _refuse(files: list[Path]) -> None:
    listed = "\n".join(f"  {file}" for file in files)
    typer.echo(
        "there already, and not as shipped; nothing was written. Name another folder, or "
        f"overwrite them by --force:\n{listed}",
        err=True,
    )
    raise typer.Exit(1)


def _tell(folder: Path, written: list[Path]) -> None:
    for name in written:
        typer.echo(folder / name)
    if not written:
        typer.echo(f"{folder}: everything is there already, as shipped")
    typer.echo(f"\nTo try it: piezod run {folder / 'simulated.yaml'}")
