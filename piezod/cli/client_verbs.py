"""The verbs for a running daemon: those of the table of commands, under its headings."""

from collections.abc import Callable, Mapping
from typing import Final

import typer

from piezod.cli.export import export
from piezod.cli.metrics import metrics
from piezod.cli.motion import goto, wave
from piezod.cli.operation import arm, mode, reset
from piezod.cli.params import history, list_params, load, restore, save
from piezod.cli.plain_verb import Verb, plain_verb
from piezod.cli.plot import plot
from piezod.cli.record import get, keep, list_records, repair, start, stop
from piezod.cli.record_show import show
from piezod.cli.reload import reload
from piezod.cli.replay import replay
from piezod.cli.status import faults, status
from piezod.cli.stream import stream
from piezod.cli.verb_list import REQUEST_VERBS
from piezod.cli.watch import watch
from piezod.messages.endpoints import ENDPOINTS, Group

OWN_FUNCTIONS: Final[Mapping[str, Callable[..., None]]] = {
    "status": status,
    "faults": faults,
    "watch": watch,
    "metrics": metrics,
    "arm": arm,
    "mode": mode,
    "goto": goto,
    "wave": wave,
    "stream": stream,
    "reset": reset,
    "params list": list_params,
    "params save": save,
    "params load": load,
    "params restore": restore,
    "params history": history,
    "record start": start,
    "record stop": stop,
    "record list": list_records,
    "record keep": keep,
    "record get": get,
    "reload": reload,
}
"""Verbs that do more than send a request without fields or for an axis."""
FAMILIES: Final = {
    "params": "List, save and restore learned parameters.\n\n"
    "Offset and scale are saved and not restored, because they drift within a day.",
    "record": "Record every cycle; list, show, copy and use recordings.",
}
"""Verbs of two words, by the first one, and its help."""
NEGATIVE_NUMBERS: Final = ("goto", "wave")
"""Verbs with positions, of which a negative one begins with a dash, as options do."""


def client_verbs() -> list[Verb]:
    """Return the verbs of the table of commands, in the order of their headings."""
    others = (Verb(row.verb, row.group, row.help) for row in ENDPOINTS.values() if row.group)
    order = list(Group)
    return sorted((*REQUEST_VERBS, *others), key=lambda verb: order.index(verb.group))


def add_client_verbs(app: typer.Typer) -> None:
    """Add all verbs of the table of commands, in its order."""
    verbs = client_verbs()
    families = {
        word: typer.Typer(no_args_is_help=True, rich_markup_mode=None, help=help)
        for word, help in FAMILIES.items()
    }
    for verb in verbs:
        family, _, word = verb.words.rpartition(" ")
        settings = {"ignore_unknown_options": True} if word in NEGATIVE_NUMBERS else None
        function = OWN_FUNCTIONS.get(verb.words) or plain_verb(verb)
        target = families[family] if family else app
        target.command(word, help=verb.help, rich_help_panel=verb.group, context_settings=settings)(
            function
        )
    for function in (show, plot, export, replay, repair):  # they need no daemon: no endpoints
        families["record"].command()(function)
    headings = {verb.words.partition(" ")[0]: verb.group for verb in verbs}
    for word, commands in families.items():
        app.add_typer(commands, name=word, rich_help_panel=headings.get(word))
