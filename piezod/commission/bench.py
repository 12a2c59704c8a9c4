"""One axis of a stage, opened to be driven by hand; left where it was found."""

import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import nan
from types import FrameType
from typing import Final, NamedTuple

from piezod.commission.session import Session
from piezod.config.daemon import DaemonConfig
from piezod.control.guard import Limits
from piezod.daemon.clock import Clock, MonotonicClock
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity
from piezod.devices.wiring import construct, pairs_of
from piezod.errors import DeviceError


class OneAxis(NamedTuple):
    """An axis that is open.

    Attributes:
        session: Drives it.
        identities: Who its devices are, by name.
    """

    session: Session
    identities: Mapping[str, Identity]


ENDING: Final = frozenset({signal.SIGINT, signal.SIGTERM, signal.SIGHUP})


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing; of SIG_IGN Python tells where a signal came just before."""


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Ignore signals that end the process until the block has ended."""
    before = {number: signal.signal(number, _ignore) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _going_back(session: Session) -> Iterator[None]:
    """Ramp back to the voltage found, whatever ends the block."""
    try:
        yield
    except BaseException as ended:
        _go_back(session, f"{ended}; " if str(ended) else "")
        raise
    _go_back(session, "")


def _go_back(session: Session, before: str) -> None:
    try:
        try:
            with _undisturbed():
                session.back()
        except Exception:
            raise
        except BaseException:  # Ctrl-C just before it is ignored; it comes once, and waits
            with _undisturbed():
                session.back()
            raise
    except Exception as error:
        raise DeviceError(
            f"{before}the axis is NOT back at {session.found_v:z.2f} V, {session.drive_v:z.2f} V "
            f"were written last: {error}"
        ) from error


@contextmanager
def one_axis(
    config: DaemonConfig, axis: str, output_v: float = nan, clock: Clock | None = None
) -> Iterator[OneAxis]:
    """Open the devices of an axis; whatever happens, go back to the voltage found.

    Args:
        config: The stage; its limits hold.
        axis: Name of the axis.
        output_v: Voltage in force, in V, where the amplifier does not read back.
        clock: Paces the cycles; that of the machine if not given.

    Raises:
        DeviceError: If a device cannot be opened, or it is not known which voltage is in force.
    """
    one, clock = config.axes[axis], clock or MonotonicClock()
    pairs = {axis: pairs_of(config.axes)[axis]}
    names = dict.fromkeys((one.sensor.device, one.amplifier.device))
    devices = construct({name: config.devices[name] for name in names}, pairs, config.seed)
    channels = Channels(devices, pairs)
    try:
        channels.open()
        channels.activate(clock.now_ns())
        low_v, high_v = one.limits.drive_min_v, one.limits.drive_max_v
        if beyond := channels.beyond_reach([(low_v, high_v)]):
            raise DeviceError(beyond)
        limits = Limits(low_v, high_v, one.limits.slew_v_per_s)
        ramp_v_per_s = one.safety.ramp_v_per_s
        session = Session(channels, limits, config.rate_hz, ramp_v_per_s, clock, output_v)
        with _going_back(session):
            yield OneAxis(session, channels.identities)
    finally:
        try:
            channels.deactivate(clock.now_ns())
        finally:  # also where Ctrl-C came in between
            channels.close()
