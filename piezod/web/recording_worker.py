"""The process that reads recordings for the page: one request in a line of JSON, one answer.

Each request has `socket`, `recording` (its name) and `what`, and for all but "contents" a span. The
process ends with its input.
"""

import json
import os
import signal
import sys
from collections.abc import Callable
from math import inf, isnan
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezod.client import StageClient
from piezod.errors import ClientError, DataError, NotRunningError
from piezod.messages.documents import Document
from piezod.records.view import view
from piezod.records.view_parts import contents, loop, marks
from piezod.resource_limits import bound
from piezod.web.recording_cache import RecordingCache

MOST_BYTES: Final = 2_000_000_000
"""Most memory of the process; the extremes of a recording of a day take a tenth of it."""
WITHIN_S: Final = 120
"""Most time of the processor for one answer, in s: then nobody waits for it any more."""
_TRY_OTHER: Final = "choose another recording, or open it with an HDF5 viewer"


class RecordingWorker:
    """Reads recordings: in their folder if this user may, otherwise a copy.

    Args:
        cache: Folder of the copies.
    """

    def __init__(self, cache: RecordingCache) -> None:
        self._cache = cache
        self._places: dict[tuple[str, str], Path] = {}
        self._parts: dict[str, Callable[[Path, Document], Any]] = {
            "contents": lambda path, _: contents(path),
            "view": lambda path, wanted: view(path, wanted["column"], *_span(wanted)),
            "marks": lambda path, wanted: marks(path, wanted["axis"], *_span(wanted)[:2]),
            "loop": lambda path, wanted: loop(path, wanted["axis"], *_span(wanted)),
        }

    def answer(self, wanted: Document) -> Document:
        """Return `{"result": …}`, or `{"error": …}` with the document of an error."""
        try:
            found = self._parts[wanted["what"]](self._place(wanted), wanted)
        except ClientError as error:
            code = "not_running" if isinstance(error, NotRunningError) else error.code
            return _error(code or "no_answer", error.what, error.remedy)
        except (DataError, ValueError, OSError) as error:
            self._places.clear()  # a file may have been removed
            return _error("recording", str(error), _TRY_OTHER)
        except MemoryError:
            what = f"the recording needs more than {MOST_BYTES / 1e9:.0f} GB of memory"
            return _error("recording", what, _TRY_OTHER)
        return {"result": as_json(found)}

    def _place(self, wanted: Document) -> Path:
        """Return the path of the file; copy it if it cannot be read where it is.

        Raises:
            ClientError: If the daemon does not know it, or does not hand it out.
        """
        key = wanted["socket"], wanted["recording"]
        if key not in self._places:
            with StageClient(socket=Path(wanted["socket"])) as client:
                path = self._found(client, wanted["recording"], copies=wanted["what"] != "contents")
            self._places[key] = path
        return self._places[key]

    def _found(self, client: StageClient, name: str, *, copies: bool) -> Path:
        document = client.recordings().document
        running = document["running"] or {}
        names = [each["name"] for each in document["recordings"]]
        if name not in (*names, running.get("name"), running.get("file")):
            raise DataError(f"there is no recording {name!r}")
        path = Path(document.get("folder", "")) / f"{name}.h5"
        if os.access(path, os.R_OK):
            return path
        stage = client.place.stage
        kept = self._cache.path(stage, name)
        if kept.is_file():
            return kept
        if not copies:
            raise DataError("the recording has to be copied before it can be read: open it")
        return self._cache.add(kept, lambda file: client.fetch_recording(name, file))


def as_json(value: Any) -> Any:
    """Return named tuples as objects, arrays as lists, and numbers that are not finite as null."""
    if hasattr(value, "_asdict"):
        return {key: as_json(each) for key, each in value._asdict().items()}
    if isinstance(value, np.ndarray):
        return [as_json(each) for each in value.tolist()]
    if isinstance(value, tuple | list):
        return [as_json(each) for each in value]
    if isinstance(value, float):
        return None if isnan(value) or abs(value) == inf else value
    return value


def main() -> None:
    """Answer until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the server, and then this process
    worker = RecordingWorker(RecordingCache.of_user())
    for line in sys.stdin:
        bound(MOST_BYTES, WITHIN_S)  # the time is that for one answer
        print(json.dumps(worker.answer(json.loads(line))), flush=True)


def _span(wanted: Document) -> tuple[float, float, int]:
    begin_s, end_s = wanted["begin_s"], wanted["end_s"]
    return (
        -inf if begin_s is None else begin_s,
        inf if end_s is None else end_s,
        wanted["points"],
    )


def _error(code: str, what: str, remedy: str) -> Document:
    return {"error": {"code": code, "what": what, "remedy": remedy}}


if __name__ == "__main__":
    main()
