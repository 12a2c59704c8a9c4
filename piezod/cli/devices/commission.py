"""`piezod commission`: the first measurements of an axis, step by step."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file

ConfigArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="CONFIG",
        help="Configuration of the stage with the devices, and with limits that the data sheets of "
        "amplifier and actuator allow.",
        readable=False,
        callback=existing_file,
    ),
]
AxisOption: TypeAlias = Annotated[
    str | None, typer.Option(metavar="NAME", help="Axis; required if there are several.")
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder for sheet, configuration and data, with a number if there is one of that "
        "name. Default: STAGE-AXIS-commissioned, in the current folder.",
    ),
]
OutputOption: TypeAlias = Annotated[
    float,
    typer.Option(
        metavar="V",
        help="Voltage in force, in V, for an amplifier without read-back: read it from its "
        "display.",
        show_default=False,
    ),
]
ConfirmOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--confirm-output",
        help="You have seen that the read-back is right, whatever was written last.",
    ),
]
YesOption: TypeAlias = Annotated[bool, typer.Option("--yes", help="Confirm every step in advance.")]


def commission(
    config: ConfigArgument,
    axis: AxisOption = None,
    out: OutOption = None,
    output_v: OutputOption = float("nan"),
    confirm_output: ConfirmOption = False,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Measure an axis: identity, noise, polarity, travel, delay, first mode.

    Each step announces the voltages that it drives and waits for a yes. It stays within the limits
    of the configuration and returns to the initial voltage. Ctrl-C, a no, or an error ends the
    procedure. The results so far are stored as an acceptance sheet, a configuration for `piezod
    run`, and the data. If the read-back contradicts the voltage that was written last, by whatever
    command, nothing is driven unless you confirm the read-back.
    """
    # What opens and moves devices takes long to import.
    from piezod.cli.devices import commission_run

    commission_run.run(
        config, axis, out, output_v, confirmed=confirm_output, asking=not yes, json=json
    )
