"""A rescuer without a process and without devices."""

from collections.abc import Sequence


class FakeRescuer:
    """Notes that it was asked to ramp down, and gives the same answer each time."""

    ready = True

    def __init__(self, rescues: list[str] | None = None, left: Sequence[str] = ()) -> None:
        self._rescues, self._left = [] if rescues is None else rescues, left

    def keep(self) -> None:
        """Do nothing: it does not end."""

    def begin(self) -> None:
        """Note a ramp."""
        self._rescues.append("ramp")

    def wait(self) -> list[str]:
        """Return the lines of its answer."""
        return list(self._left)

    def end(self) -> None:
        """Note the end."""
        self._rescues.append("end")
