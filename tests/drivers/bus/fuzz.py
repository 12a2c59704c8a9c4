"""A device and its driver as a target of the fuzzer; see `tests.fuzz`."""

from collections.abc import Callable
from importlib import import_module

from tests.drivers.bus.profiles import Profile
from tests.drivers.bus.test_fuzz import MOST_ANSWERED, use
from tests.drivers.bus.wire import MS, wired


def driver_and_emulator(profile: Profile) -> Callable[[bytes], None]:
    """Return a function that feeds bytes to the emulator, and then as replies to the driver."""
    atheris = import_module("atheris")
    with wired(profile) as wire:
        use(profile.maker("127.0.0.1:1", 20.0)(), wire)  # imports the driver

    def feed(data: bytes) -> None:
        with wired(profile) as wire:
            assert sum(map(len, wire.emulator.receive(data))) < MOST_ANSWERED
            provider = atheris.FuzzedDataProvider(data)
            wire.change = lambda reply: provider.ConsumeBytes(32) or reply
            use(profile.maker("127.0.0.1:1", 20.0)(), wire)
            wire.wait(MS)

    return feed
