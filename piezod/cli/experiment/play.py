"""`piezod play`: a periodic command by the clock of the device, learned pass by pass."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.output import print_json
from piezod.cli.paths import check_writable, existing_file
from piezod.cli.progress import progress_bar, report_part
from piezod.cli.stage_options import AxisOption, SocketOption, StageOption, connect
from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml

if TYPE_CHECKING:  # with the inverse model, they take long to import
    from piezod.experiment.play.learn import LearnedPlay, PassReport

_TablesOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        readable=False,
        help="Folder of learned tables: begin with the one in it whose waveform, interval, "
        "model and device are the same, and store the learned one there.",
    ),
]


def play(  # noqa: PLR0913, PLR0917 - each argument is an option
    file: Annotated[
        Path,
        typer.Argument(
            metavar="WAVE",
            readable=False,
            callback=existing_file,
            help="YAML with `command_um`: one period of the position, in µm.",
        ),
    ],
    passes: Annotated[
        int,
        typer.Option("--learn", metavar="PASSES", min=0, max=50, help="Largest number of passes."),
    ] = 6,
    interval_us: Annotated[
        float, typer.Option(metavar="US", min=0.1, help="Time between two points of the table, µs.")
    ] = 50.0,
    settle_s: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Time before the periods that count, s.")
    ] = 1.0,
    record_s: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Time of the periods that count, s.")
    ] = 1.0,
    tables: _TablesOption = None,
    axis: AxisOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Play a periodic waveform on a running stage, from a table that the device plays by its clock.

    The table is made by the inverse model and the response of the axis. Then it is corrected from
    pass to pass by the error that the sensor shows, until that is at the noise or no longer falls.
    Prints the error of each pass in % of the swing. The stage is disarmed at the end.
    """
    # The inverse model takes long to import.
    from piezod.experiment.live.play import learn_waveform

    wave = _wave(file)
    if tables is not None:
        tables.mkdir(parents=True, exist_ok=True)
        check_writable(tables)
    with unwinding(), connect(stage, socket) as client, progress_bar() as progress:
        progress("playing", 0.0)
        learned = learn_waveform(
            client,
            wave,
            passes,
            interval_us=interval_us,
            settle_s=settle_s,
            record_s=record_s,
            axis=axis,
            tables=tables,
            report=partial(_report, quiet=json),
            note=_note,
        )
    if json:
        print_json(_document(learned))
    else:
        typer.echo(f"Stopped: {learned.stopped}. Best: {learned.best.label}.")


def _wave(file: Path) -> WaveConfig:
    document = load_yaml(file)
    document.data.setdefault("name", file.stem[:40])
    return validate(document, WaveConfig, Context(file.parent))


def _report(done: "PassReport", *, quiet: bool) -> None:
    report_part(_pass(done))
    if not quiet:
        typer.echo(_line(done))


def _note(text: str) -> None:
    if not report_part({"note": f"Tables: {text}."}):
        typer.echo(f"Tables: {text}.", err=True)


def _line(done: "PassReport") -> str:
    worst, rms, mean = done.measured
    return (
        f"{done.label:28} max {worst:7.3f}  rms {rms:7.3f}  mean {mean:7.3f}  "
        f"noise {done.noise_pct:.3f}  % of the swing"
    )


def _pass(done: "PassReport") -> dict[str, object]:
    return {"label": done.label, **done.measured._asdict(), "noise_pct": done.noise_pct}


def _document(learned: "LearnedPlay") -> dict[str, object]:
    best = learned.best.table
    return {
        "passes": [_pass(each) for each in learned.reports],
        "best": learned.best.label,
        "stopped": learned.stopped,
        "table": {
            "interval_ns": best.interval_ns,
            "lead_in_v": best.lead_in_v.tolist(),
            "period_v": best.period_v.tolist(),
        },
    }
