"""A client over Channel Access in pure Python: caproto."""

from typing import Any

from caproto.threading.client import Context

from tests.epics.clients.dialogue import converse, note, plain


class Caproto:
    """The client."""

    def __init__(self) -> None:
        self._context = Context()
        self._subscriptions: list[Any] = []

    def get(self, name: str) -> dict[str, Any]:
        read = self._pv(name).read(data_type="control", timeout=20)
        about = read.metadata
        answer = {"value": self._single(read), "severity": int(about.severity)}
        if hasattr(about, "units"):
            answer |= {"unit": plain(about.units), "digits": plain(getattr(about, "precision", 0))}
            answer |= {"low": plain(about.lower_ctrl_limit)}
            answer |= {"high": plain(about.upper_ctrl_limit)}
        return answer

    def put(self, name: str, value: Any, *, wait: bool) -> None:
        values = value if isinstance(value, list) else [value]
        answer = self._pv(name).write(values, wait=wait, timeout=20)
        if answer and not answer.status.success:
            raise RuntimeError(answer.status.description)

    def watch(self, name: str, seen: list[dict[str, Any]]) -> None:
        subscription = self._pv(name).subscribe(data_type="time")

        def take(_: Any, read: Any) -> None:
            note(seen, self._single(read), int(read.metadata.severity))

        subscription.add_callback(take)
        self._subscriptions.append((subscription, take))

    def _pv(self, name: str) -> Any:
        (pv,) = self._context.get_pvs(name)
        pv.wait_for_connection(timeout=20)
        return pv

    @staticmethod
    def _single(read: Any) -> Any:
        values = plain(read.data)
        return values[0] if len(values) == 1 else values


if __name__ == "__main__":
    converse(Caproto())
