"""A client of EPICS as a program: requests as lines of JSON on stdin, answers on stdout."""

import json
import sys
import time
from math import isnan
from typing import Any, Protocol


class Client(Protocol):
    """A library by others."""

    def get(self, name: str) -> dict[str, Any]:
        """Return value, severity, unit, digits and limits of a record."""
        ...

    def put(self, name: str, value: Any, *, wait: bool) -> None:
        """Write, with or without completion; raise an exception if the write is refused."""
        ...

    def watch(self, name: str, seen: "list[dict[str, Any]]") -> None:
        """Add each value and severity to a list from now on."""
        ...


def note(seen: list[dict[str, Any]], value: Any, severity: int) -> None:
    """Add a value that a monitor has received."""
    seen.append({"value": plain(value), "severity": int(severity), "s": time.monotonic()})


def plain(value: Any) -> Any:
    """Return a value that JSON has: a number, a list, or a text."""
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and isnan(value) else value


def converse(client: Client) -> None:
    """Carry out requests until stdin ends."""
    seen: dict[str, list[dict[str, Any]]] = {}
    for line in sys.stdin:
        do, name, value = json.loads(line)
        answer: Any = None
        if do == "get":
            answer = client.get(name)
        elif do == "watch":
            client.watch(name, seen.setdefault(name, []))
        elif do == "seen":
            answer = list(seen[name])
        else:
            try:
                client.put(name, value, wait=do == "put")
                answer = ""
            except Exception as error:  # noqa: BLE001 - each library has its own
                answer = repr(error)
        print(json.dumps(answer, default=plain), flush=True)
