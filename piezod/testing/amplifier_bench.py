"""An amplifier under test: allowed drive voltages, and checks of the voltage in force."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, Generic, TypeVar

from piezod.devices.interface import Amplifier
from piezod.testing.check_support import T0_NS, opened

AmplifierT = TypeVar("AmplifierT", bound=Amplifier)

PATIENCE_S: Final = 2.0
"""Longest time, in s, until a written value must be in force on a device in real time."""
_POLL_S: Final = 0.01
_SETTLED_NS: Final = 1_000_000_000  # longer than any amplifier needs for one volt
_STEP_V: Final = 1.0
_BEYOND_V: Final = 1e6  # more than any amplifier gives
_TOLERANCE_V: Final = 0.1  # converter steps, offset and noise of a read-back


class Bench(Generic[AmplifierT]):
    """An open amplifier on a clock that advances only while the output settles.

    Attributes:
        rest_v: Voltages found after opening, one per output; NaN if the device does not report
            them.
        driven_v: Other voltages that the amplifier can certainly give.
        now_ns: Present instant.
    """

    def __init__(self, amplifier: AmplifierT) -> None:
        self.amplifier = amplifier
        self.now_ns = T0_NS
        self.rest_v = list(amplifier.read_back(T0_NS))
        # One volt from rest: small enough for every amplifier, and more than the tolerance.
        known_v = [0.0 if math.isnan(axis_v) else axis_v for axis_v in self.rest_v]
        self.driven_v = [axis_v + _STEP_V for axis_v in known_v]

    def leave(self) -> None:
        """Return a holding amplifier to its initial voltage, so that checks do not add up.

        An amplifier that does not report its voltage stays where it is.
        """
        if not self.amplifier.capabilities().holds or any(map(math.isnan, self.rest_v)):
            return
        self.amplifier.activate(self.now_ns)
        self.amplifier.write(self.rest_v, self.now_ns)

    def assert_taken(self, drive_v: Sequence[float]) -> None:
        """Assert that a write is accepted, and in force once the output has settled."""
        assert self.amplifier.write(drive_v, self.now_ns) is True, f"refused {drive_v} V"
        self.assert_in_force(drive_v)

    def assert_ignored(self, drive_v: Sequence[float], in_force_v: Sequence[float]) -> None:
        """Assert that a write is refused and the voltage in force stays."""
        assert self.amplifier.write(drive_v, self.now_ns) is False, f"accepted {drive_v} V"
        self.assert_in_force(in_force_v)

    def assert_in_force(self, expected_v: Sequence[float]) -> None:
        """Assert that the output settles at these voltages.

        A device on the simulated clock settles at once. A real device is polled.
        """
        end_s = time.monotonic() + PATIENCE_S
        while True:
            self.now_ns += _SETTLED_NS
            actual_v = list(self.amplifier.read_back(self.now_ns))
            assert len(actual_v) == len(expected_v), f"{actual_v} V on {len(expected_v)} outputs"
            if all(map(_near, expected_v, actual_v)):
                return
            what = f"{actual_v} V are in force, expected {expected_v} V"
            assert time.monotonic() < end_s, what
            time.sleep(_POLL_S)


def _near(expected_v: float, actual_v: float) -> bool:
    if math.isnan(expected_v):
        return math.isnan(actual_v)
    return math.isclose(expected_v, actual_v, rel_tol=0, abs_tol=_TOLERANCE_V)


@contextmanager
def bench_of(factory: Callable[[], AmplifierT]) -> Iterator[Bench[AmplifierT]]:
    """Construct and open an amplifier; restore its initial voltage and close it in any case."""
    with opened(factory) as amplifier:
        bench = Bench(amplifier)
        try:
            yield bench
        finally:
            bench.leave()


def bad_writes(rest_v: Sequence[float]) -> Iterator[list[float]]:
    """Yield values that no amplifier accepts: not finite, beyond any range, too few, too many."""
    for bad_v in (math.nan, math.inf, -math.inf, _BEYOND_V, -_BEYOND_V):
        for axis in range(len(rest_v)):
            yield [*rest_v[:axis], bad_v, *rest_v[axis + 1 :]]
    if rest_v:  # without outputs an empty write is correct
        yield []
    yield [*rest_v, 0.0]
