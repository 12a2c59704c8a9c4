"""`piezod init`: write the example configurations to a folder."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.daemon.shipped import shipped
from piezod.cli.options import JsonOption
from piezod.cli.output import print_json


def init(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="[DIR]", help="Folder for the files; made if absent.", show_default=True
        ),
    ] = Path("config"),
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite existing files that differ.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Write the example configurations: stages, their models, experiments.

    If files of the same names exist and differ, the command writes nothing, lists them, and exits
    with 1.
    """
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
        _print_written(folder, written)


def _refuse(files: list[Path]) -> None:
    listed = "\n".join(f"  {file}" for file in files)
    typer.echo(
        "nothing was written, because these files exist and differ from the examples; name another "
        f"folder, or overwrite them with --force:\n{listed}",
        err=True,
    )
    raise typer.Exit(1)


def _print_written(folder: Path, written: list[Path]) -> None:
    for name in written:
        typer.echo(folder / name)
    if not written:
        typer.echo(f"{folder}: all examples exist already, unchanged")
    typer.echo(f"\nTo try it: piezod run {folder / 'simulated.yaml'}")
