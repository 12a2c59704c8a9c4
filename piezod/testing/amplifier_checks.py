"""The part of the driver contract that amplifiers keep."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, TypeAlias

from piezod.devices.interface import Amplifier
from piezod.testing.check_support import T0_NS, assert_refused, opened

AmplifierFactory: TypeAlias = Callable[[], Amplifier]

_SETTLED_NS: Final = 1_000_000_000  # longer than any amplifier takes for one volt
_STEP_V: Final = 1.0
_BEYOND_V: Final = 1e6  # more than any amplifier gives
_TOLERANCE_V: Final = 0.1  # converter steps, offset and noise of a read-back


class _Bench:
    """An open amplifier on a clock that advances only while the output settles.

    Attributes:
        rest_v: The voltages found after opening, one per axis; NaN where the device does not tell.
        driven_v: Other voltages that the amplifier can surely give.
    """

    def __init__(self, amplifier: Amplifier) -> None:
        self.amplifier = amplifier
        self.now_ns = T0_NS
        self.rest_v = list(amplifier.read_back(T0_NS))
        known_v = [0.0 if math.isnan(axis_v) else axis_v for axis_v in self.rest_v]
        self.driven_v = [axis_v + _STEP_V for axis_v in known_v]

    def assert_taken(self, drive_v: Sequence[float]) -> None:
        """Assert that a write is taken and in force once the output has settled."""
        assert self.amplifier.write(drive_v, self.now_ns) is True, f"refused {drive_v} V"
        self.assert_in_force(drive_v)

    def assert_ignored(self, drive_v: Sequence[float], in_force_v: Sequence[float]) -> None:
        """Assert that a write is refused and what was in force stays in force."""
        assert self.amplifier.write(drive_v, self.now_ns) is False, f"took {drive_v} V"
        self.assert_in_force(in_force_v)

    def assert_in_force(self, expected_v: Sequence[float]) -> None:
        """Assert that the output settles at these voltages."""
        self.now_ns += _SETTLED_NS
        actual_v = list(self.amplifier.read_back(self.now_ns))
        assert len(actual_v) == len(expected_v), f"{actual_v} V on {len(expected_v)} axes"
        pairs = zip(expected_v, actual_v, strict=True)
        near = all(
            math.isclose(wanted, found, rel_tol=0, abs_tol=_TOLERANCE_V)
            or (math.isnan(wanted) and math.isnan(found))
            for wanted, found in pairs
        )
        assert near, f"{actual_v} V are in force, expected {expected_v} V"


@contextmanager
def _bench(factory: AmplifierFactory) -> Iterator[_Bench]:
    with opened(factory) as amplifier:
        yield _Bench(amplifier)


def writing_needs_an_active_amplifier(factory: AmplifierFactory) -> None:
    """Before activation and after deactivation a write is refused and the output stays."""
    with _bench(factory) as bench:
        bench.assert_ignored(bench.driven_v, bench.rest_v)
        bench.amplifier.activate(bench.now_ns)
        bench.amplifier.deactivate(bench.now_ns)
        bench.assert_ignored(bench.driven_v, bench.rest_v)


def reading_back_needs_an_open_amplifier(factory: AmplifierFactory) -> None:
    """While it is closed an amplifier takes no write, and the voltage in force is unknown."""
    amplifier = factory()
    for _ in range(2):  # before it was opened, and after it was closed
        assert_refused("read_back while closed", lambda: amplifier.read_back(T0_NS))
        assert amplifier.write([0.0], T0_NS) is False, "a closed amplifier took a write"
        with opened(lambda: amplifier):
            pass


def activating_leaves_the_output_at_rest(factory: AmplifierFactory) -> None:
    """Activation by itself drives nothing."""
    with _bench(factory) as bench:
        bench.amplifier.activate(bench.now_ns)

        bench.assert_in_force(bench.rest_v)


def a_write_comes_into_force(factory: AmplifierFactory) -> None:
    """What was written is read back once the output has settled."""
    with _bench(factory) as bench:
        bench.amplifier.activate(bench.now_ns)

        bench.assert_taken(bench.driven_v)


def a_bad_write_is_refused_as_a_whole(factory: AmplifierFactory) -> None:
    """One value that is not finite or beyond range, or a wrong number of them, changes no axis."""
    with _bench(factory) as bench:
        bench.amplifier.activate(bench.now_ns)
        bench.assert_taken(bench.driven_v)
        for bad_v in _bad_writes(bench.rest_v):
            bench.assert_ignored(bad_v, bench.driven_v)


def deactivating_brings_the_output_to_rest(factory: AmplifierFactory) -> None:
    """After deactivation the output is as before activation, or as it was if the device holds."""
    with _bench(factory) as bench:
        bench.amplifier.activate(bench.now_ns)
        bench.assert_taken(bench.driven_v)
        bench.amplifier.deactivate(bench.now_ns)

        holds = bench.amplifier.capabilities().holds
        bench.assert_in_force(bench.driven_v if holds else bench.rest_v)


def _bad_writes(rest_v: Sequence[float]) -> Iterator[list[float]]:
    for bad_v in (math.nan, math.inf, -math.inf, _BEYOND_V, -_BEYOND_V):
        for axis in range(len(rest_v)):
            yield [*rest_v[:axis], bad_v, *rest_v[axis + 1 :]]
    if rest_v:
        yield []
    yield [*rest_v, 0.0]


AMPLIFIER_CHECKS: Final = (
    writing_needs_an_active_amplifier,
    reading_back_needs_an_open_amplifier,
    activating_leaves_the_output_at_rest,
    a_write_comes_into_force,
    a_bad_write_is_refused_as_a_whole,
    deactivating_brings_the_output_to_rest,
)
