"""The driver `emulated`: a rig in another process, sensor and amplifier of all its axes in one."""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.interface import Capabilities, DriverPlugin, Identity, Sample, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.emulated.codec import Greeting, Op, RigReply, RigRequest
from piezod_drivers.emulated.options import EmulatedOptions, socket_path
from piezod_drivers.emulated.session import RigSession

_NUMBERS: Final = 1 << 32


class EmulatedRig:
    """A rig that `piezod emulate` hosts; implements `Sensor`, `Amplifier`, `TellsStatus`.

    Its time is real: the physics continues without calls. A sample has the instant of the call; the
    rig takes it within the exchange, some 50 µs later. A reply also has the output of the
    amplifiers, so `read_back` at the instant of a `read` or `write` needs no exchange.

    The amplifiers hold: the voltage stays after `deactivate`, after `close` and after the death of
    this process. Most real amplifiers do the same. It is safer than a step to 0 V by a process that
    may be faulty. Ramp down before, or run `piezod safe` after.

    If the rig is lost, samples are invalid, writes are refused and the voltage in force is NaN;
    `read` tries at intervals to connect again. If the rig has restarted meanwhile, and is at rest,
    its status reports that for a second.

    Args:
        axes: Names of the axes, at least one.
    """

    def __init__(self, options: EmulatedOptions, axes: tuple[str, ...]) -> None:
        self._axes = axes
        self._session = RigSession(socket_path(options.socket), options.deadline_ms * 1e-3)
        self._greeting: Greeting | None = None
        self._active = False
        self._number = 0
        self._no_drive = (0.0,) * len(axes)
        self._unknown_v = [nan] * len(axes)
        none = [NO_FLAGS] * len(axes)
        self._no_flags = none + none  # each axis is an input and an output
        # Only outputs report the restart: it does not make a sample wrong.
        self._restarted = none + [frozenset({DeviceFlag.RESTARTED})] * len(axes)
        self._in_force_v: Sequence[float] = self._unknown_v
        self._in_force_ns: int | None = None
        self._run_id = ""
        self._restarted_ns: int | None = None

    def open(self) -> Identity:
        """Connect to the rig; its voltages stay.

        Raises:
            DeviceUnavailableError: If there is no rig at the socket, or it serves another client.
            DeviceError: If it is already open, or the rig has other axes.
        """
        if self._greeting is not None:
            raise DeviceError("the emulated rig is already open")
        greeting = self._session.connect()
        if greeting.axes != self._axes:
            self._session.close()
            has, wanted = ", ".join(greeting.axes), ", ".join(self._axes)
            raise DeviceError(f"the emulated rig has axes {has}, configured are {wanted}")
        self._greeting, self._run_id, self._restarted_ns = greeting, greeting.run_id, None
        return greeting.identity

    def capabilities(self) -> Capabilities:
        """Return axes and highest rate."""
        greeting = self._require_open()
        return Capabilities(greeting.axes, greeting.axes, True, greeting.max_rate_hz, holds=True)

    def activate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface's, time is the rig's own
        """Accept writes from now on."""
        self._require_open()
        self._active = True

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface's, time is the rig's own
        """Refuse writes from now on; the voltages are held."""
        self._active = False

    def close(self) -> None:
        """Disconnect; the voltages are held."""
        self._active = False
        self._greeting = None
        self._in_force_ns = None
        self._session.close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take a sample of each axis; invalid without a reply in time. Real-time safe."""
        if not self._active or self._greeting is None:
            raise DeviceError("the emulated rig is not active")
        self._session.reconnect(self._greeting, now_ns)
        # `reconnect` may have found a rig that was started again.
        if self._session.run_id != self._run_id:
            self._run_id, self._restarted_ns = self._session.run_id, now_ns
        reply = self._exchange(Op.READ, now_ns, self._no_drive)
        if reply is None:
            return [Sample(now_ns, 0.0, False)] * len(self._axes)
        return [
            Sample(now_ns, position_um, valid)
            for position_um, valid in zip(reply.position_um, reply.valid, strict=True)
        ]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Command a voltage for each axis, in V; all are accepted or none. Real-time safe.

        Returns:
            Whether the rig confirms in time that they were accepted.
        """
        if not self._active or len(drive_v) != len(self._axes):
            return False
        reply = self._exchange(Op.WRITE, now_ns, drive_v)
        return reply is not None and reply.taken

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Measure the output of each amplifier, in V; NaN without a reply. Real-time safe."""
        self._require_open()
        # The exchange of this instant already had the voltages.
        if now_ns != self._in_force_ns:
            self._exchange(Op.READ_BACK, now_ns, self._no_drive)
        return self._in_force_v

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Report for a second that the rig was lost and has restarted. Real-time safe."""
        self._require_open()
        since_ns = self._restarted_ns
        restarted = since_ns is not None and now_ns - since_ns < NS_PER_S
        return self._restarted if restarted else self._no_flags

    def _exchange(self, op: Op, now_ns: int, drive_v: Sequence[float]) -> RigReply | None:
        self._number = (self._number + 1) % _NUMBERS
        reply = self._session.exchange(RigRequest(op, self._number, now_ns, drive_v))
        self._in_force_ns = now_ns
        self._in_force_v = self._unknown_v if reply is None else reply.in_force_v
        return reply

    def _require_open(self) -> Greeting:
        if self._greeting is None:
            raise DeviceError("the emulated rig is not open")
        return self._greeting


def _create(options: EmulatedOptions, wiring: Wiring, _seed: int) -> EmulatedRig:
    return EmulatedRig(options, wiring.channels)  # the seed is that of the rig


PLUGIN: Final = DriverPlugin(
    name="emulated",
    summary="a stage in another process, hosted by `piezod emulate`, over a unix socket",
    options_model=EmulatedOptions,
    create=_create,
    confirmed_on_hardware=False,
)
