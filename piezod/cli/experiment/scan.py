"""`piezod scan`: a scan, in virtual time or on a running stage."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.experiment.experiment import SeedOption
from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file
from piezod.cli.stage_options import SocketOption, StageOption, check_live, connect

_FileArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        readable=False,
        callback=existing_file,
        help="YAML with `scan:`. In virtual time it is an experiment, with devices and axes.",
    ),
]
_OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        readable=False,
        help="File to write, HDF5 in the layout of NeXus; a number is added if it exists. Default: "
        "the name of FILE with .nxs, in the current folder.",
    ),
]
_LiveOption: TypeAlias = Annotated[
    bool, typer.Option("--live", help="Scan on a running stage, with its devices and models.")
]
_TablesOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        exists=True,
        file_okay=False,
        readable=False,
        help="Folder of learned tables: begin with the line in it whose conditions are the same, "
        "and store the learned one there.",
    ),
]


def scan(  # noqa: PLR0913, PLR0917 - each argument is an option
    file: _FileArgument,
    out: _OutOption = None,
    seed: SeedOption = None,
    live: _LiveOption = False,
    tables: _TablesOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Scan lines, a raster or a stack, and store a picture.

    A device plays it from a table, unless the file says in which mode the loop scans. The line of a
    table is learned alone first, then in whole frames, each sweep with an offset and a size of its
    own. The last frame is stored sweep by sweep: after an abort the file has all sweeps before
    it. Prints the errors of each frame in pixels, in the middle 80 % of the lines. With --live the
    stage is disarmed at the end.
    """
    check_live(live=live, seed=seed, only_live={"--stage": stage, "--socket": socket})
    # numba, scipy and h5py take long to import.
    from piezod.cli.experiment.scan_run import run

    run(file, out, seed, tables, (lambda: connect(stage, socket)) if live else None, json=json)
