"""A client over PV Access: p4p."""

from typing import Any

from p4p.client.thread import Context

from tests.epics.clients.dialogue import converse, note, plain


class P4p:
    """The client."""

    def __init__(self) -> None:
        self._context = Context("pva", nt=False)
        self._monitors: list[Any] = []

    def get(self, name: str) -> dict[str, Any]:
        raw = self._context.get(name)
        answer = {"value": plain(_value(raw)), "severity": raw["alarm.severity"]}
        if "display" in raw and "precision" in raw.display:
            shown = raw.display
            answer |= {"unit": shown.units, "digits": shown.precision}
        if "control" in raw:
            answer |= {"low": raw.control.limitLow, "high": raw.control.limitHigh}
        return answer

    def put(self, name: str, value: Any, *, wait: bool) -> None:
        self._context.put(name, {"value": value}, wait=wait, timeout=20)

    def watch(self, name: str, seen: list[dict[str, Any]]) -> None:
        def take(raw: Any) -> None:
            note(seen, _value(raw), raw["alarm.severity"])

        self._monitors.append(self._context.monitor(name, take))


def _value(raw: Any) -> Any:
    value = raw["value"]
    return value.index if hasattr(value, "index") and hasattr(value, "choices") else value


if __name__ == "__main__":
    converse(P4p())
