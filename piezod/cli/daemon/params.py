"""`piezod params`: the learned and the saved parameters of a stage."""

from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, new_table, print_json
from piezod.cli.stage_options import SocketOption, StageOption, connect, print_answer


def list_params(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Print the parameters in use."""
    with connect(stage, socket) as client:
        found = client.params()
    if json:
        print_json(found.document)
        return
    console = new_console()
    for name, values in found.axes.items():
        console.print(f"axis {name}")
        for key, value in values.items():
            console.print(f"  {key}: {_shown(value)}", soft_wrap=True)
    console.print("not saved" if found.sequence is None else f"saved as {found.sequence}")


def _shown(value: object) -> object:
    if isinstance(value, dict):
        return value.get("method", "…")  # a model; people do not read its weights
    return "–" if value is None else value


def save(stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False) -> None:
    """Save the parameters in use and print their number."""
    with connect(stage, socket) as client:
        saved = client.save_params()
    print_answer(saved, f"saved as {saved.sequence}", json=json)


def load(stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False) -> None:
    """Load the newest saved parameters and print their number."""
    with connect(stage, socket) as client:
        loaded = client.load_params()
    print_answer(loaded, f"loaded {loaded.sequence}", json=json)


def restore(
    sequence: Annotated[
        int, typer.Argument(metavar="NUMBER", min=1, help="Number in `piezod params history`.")
    ],
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Load earlier saved parameters and print their number."""
    with connect(stage, socket) as client:
        restored = client.restore_params(sequence)
    print_answer(restored, f"restored {restored.sequence}", json=json)


def history(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Print a table of the saved parameters."""
    with connect(stage, socket) as client:
        found = client.params_history()
    if json:
        print_json(found.document)
        return
    table = new_table("number", "saved at", "by", "axes", "")
    for each in found.history:
        table.add_row(
            str(each.sequence), each.saved_at, each.saved_by, ", ".join(each.axes), each.why
        )
    new_console().print(table if found.history else "nothing is saved")
