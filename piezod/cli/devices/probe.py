"""`piezod probe`: identity, capabilities and speed of the devices of a stage."""

from typing import Annotated, TypeAlias

import typer

from piezod.cli.options import ConfigArgument, JsonOption

WiggleOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--wiggle", help="Then move each axis by a few volts, within its limits, and back."
    ),
]
YesOption: TypeAlias = Annotated[
    bool, typer.Option("--yes", help="Wiggle without a confirmation of each step.")
]
TraceOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--trace",
        help="Print all bytes on serial ports and TCP connections to stderr, as text and as "
        "hexadecimal numbers; only a few exchanges are then timed.",
    ),
]


def probe(
    config: ConfigArgument,
    wiggle: WiggleOption = False,
    yes: YesOption = False,
    trace: TraceOption = False,
    json: JsonOption = False,
) -> None:
    """Inspect the devices of a stage; moves nothing without --wiggle.

    Opens each device and prints its identity, its capabilities, the values of its channels, the
    duration of an exchange, and the rate that this allows: for the device alone, and for all
    together. Exits with 69 if a device is absent.
    """
    # What opens and moves devices takes long to import.
    from piezod.cli.devices import probe_run

    probe_run.run(config, wiggle=wiggle, yes=yes, trace=trace, json=json)
