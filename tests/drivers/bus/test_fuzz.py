"""Unintended bytes in both directions make no emulator and no driver fail."""

import tracemalloc
from collections.abc import Callable
from itertools import count
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from piezod.errors import DeviceError
from tests.drivers.bus.profiles import PROFILES, Profile
from tests.drivers.bus.wire import MS, Wire, wired

MOST_ANSWERED = 1_000_000
"""Highest number of bytes of the reply to one request."""
MOST_KEPT = 10_000
JUNK_BYTES = 4_000
"""Bytes of one piece; eleven pieces are more than may be kept."""

every_profile = pytest.mark.parametrize(
    "profile",
    [
        pytest.param(each, marks=[pytest.mark.stress] if each.takes_long else [], id=each.name)
        for each in PROFILES
    ],
)
few = settings(max_examples=10, suppress_health_check=list(HealthCheck))

Change = Callable[[bytes], bytes]


def _spoilt(place: int, cut: int, put: bytes) -> Change:
    """Return a function that replaces some bytes by others."""

    def change(data: bytes) -> bytes:
        at = place % (len(data) + 1)
        return data[:at] + put + data[at + cut :]

    return change


CHANGES = st.builds(_spoilt, st.integers(0, 300), st.integers(0, 8), st.binary(max_size=8)) | (
    st.binary(max_size=64).map(lambda data: lambda _: data)
)


def use(device: Any, wire: Wire) -> None:
    """Call every method of a device."""
    try:
        device.open()
        device.activate(wire.now_ns)
    except DeviceError:
        device.close()
        return
    inputs, outputs = device.capabilities()[:2]
    for value in (1.0, 2.0):
        if outputs:
            device.write([value] * len(outputs), wire.now_ns)
            device.read_back(wire.now_ns)
        if inputs:
            assert len(device.read(wire.now_ns)) == len(inputs)
        if inputs and outputs and hasattr(device, "exchange"):
            device.exchange([value] * len(outputs), wire.now_ns)
        assert len(device.status(wire.now_ns)) == len(inputs) + len(outputs)
        wire.wait(MS)
    device.deactivate(wire.now_ns)
    device.close()


@every_profile
@pytest.mark.few(6)
def test_driver_survives_whatever_is_answered(profile: Profile) -> None:
    """With any replies, opening and activating raise only `DeviceError`, all else nothing."""

    @few
    @given(changes=st.lists(CHANGES, min_size=1, max_size=20), from_number=st.integers(0, 40))
    def check(changes: list[Change], from_number: int) -> None:
        with wired(profile) as wire:
            number = count()

            def change(reply: bytes) -> bytes:
                place = next(number) - from_number
                return changes[place % len(changes)](reply) if place >= 0 else reply

            wire.change = change
            use(profile.maker("127.0.0.1:1", 20.0)(), wire)

    check()


@every_profile
def test_emulator_survives_whatever_comes(profile: Profile) -> None:
    """Spoilt, cut or invalid requests raise nothing and have short replies."""
    with wired(profile) as wire:
        use(profile.maker("127.0.0.1:1", 20.0)(), wire)
        known = [request for request in wire.requests if request] or [b"?"]

        @few
        @given(parts=st.lists(st.tuples(st.sampled_from(known), CHANGES), max_size=20))
        def check(parts: list[tuple[bytes, Change]]) -> None:
            for request, change in parts:
                answered = [*wire.emulator.receive(change(request)), *wire.emulator.due()]
                assert sum(map(len, answered)) < MOST_ANSWERED
                wire.now_ns += MS

        check()


@every_profile
@pytest.mark.parametrize("junk", [b"A", b"\0", b"\xff", b"1"])
@pytest.mark.few(20)
def test_emulator_keeps_little(profile: Profile, junk: bytes) -> None:
    """Bytes without an end are not collected for ever."""
    with wired(profile) as wire:
        wire.emulator.receive(junk * JUNK_BYTES)
        tracemalloc.start()
        for _ in range(10):
            wire.emulator.receive(junk * JUNK_BYTES)
        kept, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()

    assert kept < MOST_KEPT
