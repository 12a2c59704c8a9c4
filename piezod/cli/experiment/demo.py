"""`piezod demo`: run the experiment of the paper from the shipped file."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.daemon.shipped import shipped
from piezod.cli.experiment.experiment import experiment
from piezod.cli.options import JsonOption


def demo(
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            readable=False,
            help="Folder for report, figures and data; the results of an earlier run in it are "
            "replaced.",
        ),
    ] = Path("piezod-demo"),
    json: JsonOption = False,
) -> None:
    """Run the experiment of the paper on a simulated stage and write a report.

    It takes about half a minute, and needs no files and no device. The report shows the figures of
    the paper and its errors beside those of this run. `piezod init` writes the experiment file,
    `experiments/qiu.yaml`, for changes of your own.
    """
    experiment(shipped("config") / "experiments" / "qiu.yaml", out, json=json)
