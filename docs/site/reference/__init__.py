"""Pages made from the code while the site is built."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from docs.site.reference import changes, client, commands, epics, faults, http, keys, recordings

REFERENCE: Final[Mapping[str, str]] = {
    "Keys of a stage": "reference/stage.md",
    "Keys of an experiment": "reference/experiment.md",
    "Options of the drivers": "reference/drivers.md",
    "Commands": "reference/commands.md",
    "Python client": "reference/client.md",
    "HTTP": "reference/http.md",
    "Table of faults": "reference/faults.md",
    "Columns of a recording": "reference/recordings.md",
    "EPICS records": "reference/epics.md",
}
"""Titles and URIs of the pages, in their order."""
UPGRADE: Final = "reference/upgrade.md"
_WRITERS: Final[Mapping[str, Callable[[], Iterable[str]]]] = {
    "reference/stage.md": keys.stage_page,
    "reference/experiment.md": keys.experiment_page,
    "reference/drivers.md": keys.drivers_page,
    "reference/commands.md": commands.page,
    "reference/client.md": client.page,
    "reference/http.md": http.page,
    "reference/faults.md": faults.page,
    "reference/recordings.md": recordings.page,
    "reference/epics.md": epics.page,
    UPGRADE: changes.page,
}


def reference_pages() -> dict[str, str]:
    """Return the Markdown of each page, by its URI."""
    return {uri: "\n".join(write()) + "\n" for uri, write in _WRITERS.items()}
