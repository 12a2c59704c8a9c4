"""Driver contract: the checks of amplifiers."""

from collections.abc import Callable
from typing import Final, TypeAlias

from piezod.devices.interface import Amplifier
from piezod.testing.amplifier_bench import bad_writes, bench_of
from piezod.testing.check_support import T0_NS, assert_refused, opened

AmplifierFactory: TypeAlias = Callable[[], Amplifier]


def writing_needs_an_active_amplifier(factory: AmplifierFactory) -> None:
    """Before activation and after deactivation a write is refused and the output stays."""
    with bench_of(factory) as bench:
        bench.assert_ignored(bench.driven_v, bench.rest_v)
        bench.amplifier.activate(bench.now_ns)
        bench.amplifier.deactivate(bench.now_ns)
        bench.assert_ignored(bench.driven_v, bench.rest_v)


def reading_back_needs_an_open_amplifier(factory: AmplifierFactory) -> None:
    """A closed amplifier refuses writes and read-back."""
    amplifier = factory()
    for _ in range(2):  # before opening, and after closing
        assert_refused("read_back while closed", lambda: amplifier.read_back(T0_NS))
        assert amplifier.write([0.0], T0_NS) is False, "a closed amplifier accepted a write"
        with opened(lambda: amplifier):
            pass


def activating_leaves_the_output_at_rest(factory: AmplifierFactory) -> None:
    """Activation alone drives nothing."""
    with bench_of(factory) as bench:
        bench.amplifier.activate(bench.now_ns)

        bench.assert_in_force(bench.rest_v)


def a_write_comes_into_force(factory: AmplifierFactory) -> None:
    """The written value is read back once the output has settled."""
    with bench_of(factory) as bench:
        bench.amplifier.activate(bench.now_ns)

        bench.assert_taken(bench.driven_v)


def a_bad_write_is_refused_as_a_whole(factory: AmplifierFactory) -> None:
    """One bad value, or a wrong number of values, changes no output."""
    with bench_of(factory) as bench:
        bench.amplifier.activate(bench.now_ns)
        bench.assert_taken(bench.driven_v)
        for bad_v in bad_writes(bench.rest_v):
            bench.assert_ignored(bad_v, bench.driven_v)


def deactivating_brings_the_output_to_rest(factory: AmplifierFactory) -> None:
    """After deactivation the output is as before activation, or unchanged if the device holds."""
    with bench_of(factory) as bench:
        bench.amplifier.activate(bench.now_ns)
        bench.assert_taken(bench.driven_v)
        bench.amplifier.deactivate(bench.now_ns)

        holds = bench.amplifier.capabilities().holds
        bench.assert_in_force(bench.driven_v if holds else bench.rest_v)


AMPLIFIER_CHECKS: Final = (
    writing_needs_an_active_amplifier,
    reading_back_needs_an_open_amplifier,
    activating_leaves_the_output_at_rest,
    a_write_comes_into_force,
    a_bad_write_is_refused_as_a_whole,
    deactivating_brings_the_output_to_rest,
)
