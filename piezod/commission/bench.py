"""One axis of a stage, opened for manual driving, and returned to its initial voltage."""

import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from math import nan
from types import FrameType
from typing import Final, NamedTuple

from piezod.commission.output import Output
from piezod.commission.session import Session
from piezod.config.daemon import DaemonConfig
from piezod.control.guard import Limits
from piezod.daemon.clock import Clock, MonotonicClock
from piezod.daemon.output_notes import OutputNotes
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity
from piezod.devices.wiring import construct, pairs_of
from piezod.errors import DeviceError
from piezod.experiment.session.devices import owned


class OneAxis(NamedTuple):
    """An open axis."""

    session: Session  #: Drives it.
    identities: Mapping[str, Identity]  #: Identities of its devices, by name.


ENDING: Final = frozenset({signal.SIGINT, signal.SIGTERM, signal.SIGHUP})


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing. With SIG_IGN, Python would print an error for a signal that came just before."""


@contextmanager
def _signals_ignored() -> Iterator[None]:
    """Ignore signals that end the process until the block has ended."""
    before = {number: signal.signal(number, _ignore) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _returning(session: Session) -> Iterator[None]:
    """Ramp back to the initial voltage, whatever ends the block."""
    try:
        yield
    except BaseException as ended:
        _ramp_back(session, f"{ended}; " if str(ended) else "")
        raise
    _ramp_back(session, "")


def _ramp_back(session: Session, before: str) -> None:
    """Ramp back without interruption; `before` is the error that made it necessary."""
    try:
        try:
            with _signals_ignored():
                session.back()
        except Exception:
            raise
        except BaseException:  # Ctrl-C in the moment before it is ignored: ramp first, then end
            with _signals_ignored():
                session.back()
            raise
    except Exception as error:
        raise DeviceError(
            f"{before}the axis has NOT returned to {session.found_v:z.2f} V, the last written "
            f"voltage is {session.drive_v:z.2f} V: {error}"
        ) from error


@contextmanager
def one_axis(
    config: DaemonConfig,
    axis: str,
    notes: OutputNotes,
    output_v: float = nan,
    clock: Clock | None = None,
    *,
    confirmed: bool = False,
) -> Iterator[OneAxis]:
    """Open the devices of an axis; in any case return to the initial voltage at the end.

    Args:
        config: The stage; its limits apply.
        axis: Name of the axis.
        notes: What was written last; takes each voltage before it is written.
        output_v: Voltage in force, in V, for an amplifier without read-back.
        clock: Clock of the cycles; by default that of the machine.
        confirmed: Whether a person answers for the read-back, whatever was written last.

    Raises:
        DeviceError: If a device cannot be opened, or the voltage in force is unknown.
        OSError: If the identities of the devices cannot be stored.
    """
    one, clock = config.axes[axis], clock or MonotonicClock()
    if one.sensor is None:
        raise DeviceError(
            f"axis {axis} has no sensor, and commissioning measures its displacement: configure "
            "one, borrowed if need be"
        )
    pairs = {axis: pairs_of(config.axes)[axis]}
    # Devices of other axes stay closed; a dict, because one device may serve both roles.
    names = dict.fromkeys((one.sensor.device, one.amplifier.device))
    used = {name: config.devices[name] for name in names}
    channels = Channels(construct(used, pairs, config.seed, config.lines), pairs, config.lines)
    range_v = (one.limits.drive_min_v, one.limits.drive_max_v)
    limits = Limits(*range_v, one.limits.slew_v_per_s)
    with owned(channels, clock.now_ns, lambda opened: opened.beyond_reach([range_v]), notes.leave):
        # Every way to a voltage uses the ramp of the safety section, which is slow on purpose.
        ramp_v_per_s = one.safety.ramp_v_per_s
        notes.meet(channels)
        last_v = nan if confirmed else notes.last_v(axis)
        able = channels.capabilities()
        output = Output(
            channels,
            limits.read_back_tolerance_v,
            clock,
            last_v if able.read_back else output_v,
            one.limits.rest_v if able.watchdog else nan,
            partial(notes.note, axis),
        )
        session = Session(channels, output, limits, config.rate_hz, ramp_v_per_s, clock)
        notes.note(axis, session.found_v)
        with _returning(session):
            yield OneAxis(session, channels.identities)
