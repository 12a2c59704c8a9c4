"""Driver contract: the checks of devices that read and write in one exchange."""

import math
from collections.abc import Callable, Sequence
from typing import Final, Protocol, TypeAlias

from piezod.devices.interface import Amplifier, Exchanges, Sample, Sensor
from piezod.testing.amplifier_bench import Bench, bad_writes, bench_of
from piezod.testing.check_support import assert_refused


class ExchangingDevice(Sensor, Amplifier, Exchanges, Protocol):
    """A sensor and amplifier with one exchange for both."""


ExchangingFactory: TypeAlias = Callable[[], ExchangingDevice]


def an_exchange_needs_an_active_device(factory: ExchangingFactory) -> None:
    """Before activation and after deactivation an exchange is refused, like a read."""
    with bench_of(factory) as bench:
        device, drive_v = bench.amplifier, bench.driven_v
        assert_refused("exchange before activate", lambda: device.exchange(drive_v, bench.now_ns))
        device.activate(bench.now_ns)
        device.deactivate(bench.now_ns)
        assert_refused("exchange after deactivate", lambda: device.exchange(drive_v, bench.now_ns))
        bench.assert_in_force(bench.rest_v)


def an_exchange_writes_and_reads(factory: ExchangingFactory) -> None:
    """The written value comes into force, and each input has a sample no later than the call."""
    with bench_of(factory) as bench:
        bench.amplifier.activate(bench.now_ns)
        accepted, samples = bench.amplifier.exchange(bench.driven_v, bench.now_ns)

        assert accepted is True, f"refused {bench.driven_v} V"
        _assert_samples(bench, samples)
        bench.assert_in_force(bench.driven_v)


def a_bad_exchange_is_refused_and_reads(factory: ExchangingFactory) -> None:
    """Values that a write refuses change no output, and the samples still come."""
    with bench_of(factory) as bench:
        bench.amplifier.activate(bench.now_ns)
        bench.assert_taken(bench.driven_v)
        for bad_v in bad_writes(bench.rest_v):
            accepted, samples = bench.amplifier.exchange(bad_v, bench.now_ns)

            assert accepted is False, f"accepted {bad_v} V"
            _assert_samples(bench, samples)
            bench.assert_in_force(bench.driven_v)


def _assert_samples(bench: Bench[ExchangingDevice], samples: Sequence[Sample]) -> None:
    inputs = bench.amplifier.capabilities().inputs
    assert len(samples) == len(inputs), f"{len(samples)} samples of {len(inputs)} inputs"
    for sample in samples:
        assert math.isfinite(sample.position_um) or not sample.valid, f"valid: {sample}"
        assert sample.t_ns <= bench.now_ns, f"{sample} of a call at {bench.now_ns}"


EXCHANGE_CHECKS: Final = (
    an_exchange_needs_an_active_device,
    an_exchange_writes_and_reads,
    a_bad_exchange_is_refused_and_reads,
)
