"""The conversation with a CiA 401 node: PDOs and SYNC in the loop, SDO before it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.codec import Scale, pack, unpack
from piezod_drivers.can_bus.cia401.health import NodeHealth
from piezod_drivers.can_bus.cia401.options import Cia401Options
from piezod_drivers.can_bus.cia401.sdo_words import SDO_BYTES, read_requests, read_words
from piezod_drivers.can_bus.conversation import CanConversation
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus
from piezod_drivers.can_bus.options import max_rate_hz

if TYPE_CHECKING:
    from piezod_drivers.can_bus.cia401.sdo_client import SdoAccess
    from piezod_drivers.can_bus.cia401.setup import PdoLayout

MS: Final = 1_000_000
_HEARTBEATS_PER_TIMEOUT: Final = 4
"""Number of heartbeats that the host sends within the node's time-out."""
_MISSED_HEARTBEATS: Final = 3
"""A node counts as silent when this many of its heartbeats are missing."""
_SYNC: Final = Frame(objects.SYNC)


class Cia401Dialogue:
    """Implements `devices.bus.dialogue.ExchangingDialogue` for a CiA 401 node.

    One exchange is: process data with the outputs, SYNC, process data with the inputs. The node
    replies to the SYNC, which comes after the outputs, so this reply confirms them. If no input is
    in use, the node does not reply. Then reading back confirms the outputs or, if that is switched
    off, the node's heartbeat.

    If the node has outputs and none of them is in use, another program may drive it. Then the node
    is neither configured nor started, no SYNC is sent, and inputs are read by SDO.

    Args:
        options: Options of the node.
        wiring: The channels in use.
        bus: The bus.
    """

    def __init__(self, options: Cia401Options, wiring: Wiring, bus: FrameBus) -> None:
        self._options, self._wiring, self._bus = options, wiring, bus
        inputs = [options.inputs[name] for name in wiring.inputs]
        outputs = [options.outputs[name] for name in wiring.outputs]
        self._input_numbers = [channel.number for channel in inputs]
        self._output_numbers = [channel.number for channel in outputs]
        self._input_scales = [_scale(one.code_at_min, one.code_at_max, one.range) for one in inputs]
        self._output_scales = [
            _scale(one.code_at_min, one.code_at_max, one.range) for one in outputs
        ]
        self._ranges = [channel.range for channel in outputs]
        self._safe_codes = [(c.number, c.safe_code) for c in outputs if c.safe_code is not None]
        self._reads_back_by_pdo = options.read_back == "pdo" and bool(outputs)
        self._reads_only = bool(options.outputs) and not outputs
        self._expects_tpdo = (bool(inputs) and not self._reads_only) or self._reads_back_by_pdo
        node = options.node
        self._read_inputs = read_requests(node, objects.INPUT, self._input_numbers)
        self._read_outputs = read_requests(node, objects.OUTPUT, self._output_numbers)
        self._heartbeat_frame = Frame(
            objects.HEARTBEAT + options.host_node, bytes((objects.OPERATIONAL,))
        )
        self._health = NodeHealth()
        self._sdo: SdoAccess | None = None
        self._watchdog = self._watchdog_armed = self._watchdog_runs = False
        self._node_sends_heartbeats = False
        self._heartbeat_sent_ns = self._node_heard_ns = 0
        self._heartbeat_period_ns = options.watchdog_ms * MS // _HEARTBEATS_PER_TIMEOUT
        self._in_force: list[float] = []
        self._in_force_ns: int | None = None
        self._input_flags: list[Flags] = []
        self._conversation = self._make_conversation(())
        self._rpdo: PdoLayout | None = None
        self._tpdo: PdoLayout | None = None
        self._tpdo_ids: frozenset[int] = frozenset()

    def open(self) -> Identity:
        """Connect and identify the node; its outputs and its state stay as they are.

        Raises:
            DeviceUnavailableError: If it does not reply, or canopen is not installed.
            DeviceError: If it is no CiA 401 node.
            LineFault: If the bus fails.
        """
        try:
            from piezod_drivers.can_bus.cia401 import (  # noqa: PLC0415 - optional
                sdo_client,
                setup,
            )
        except ImportError as error:
            what = f'the canopen library is missing ({error}): pip install "piezod[can]"'
            raise DeviceUnavailableError(what) from error
        options, node = self._options, self._options.node
        self._health.clear()
        self._conversation, self._tpdo = self._make_conversation(()), None
        self._bus.open(self._accepted())
        access = self._sdo = sdo_client.SdoAccess(node, self._bus, self._handle_frame)
        try:
            identity = setup.identify(access)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
            what = f"{fault}: check node number, power supply, bit rate and both terminations"
            raise DeviceUnavailableError(what) from fault
        self._watchdog = bool(self._safe_codes) and all(
            setup.has_object(access, *needed)
            for number, _ in self._safe_codes
            for needed in ((objects.ERROR_VALUE, number), (objects.CONSUMER_HEARTBEAT, 1))
        )
        self._max_rate_hz = max_rate_hz(options.bus, self._frame_sizes())
        return identity

    def close(self) -> None:
        """Disconnect; the outputs keep their values. Never raises."""
        self._bus.close()
        self._sdo = None

    def capabilities(self) -> Capabilities:
        """Return the channels, the highest rate, and whether the node has a watchdog."""
        return Capabilities(
            self._wiring.inputs,
            self._wiring.outputs,
            self._options.read_back != "none",
            self._max_rate_hz,
            holds=True,
            watchdog=self._watchdog,
        )

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return the configured range of each output, in its unit."""
        return self._ranges

    def activate(self) -> None:
        """Configure the process data, arm the watchdog and start the node.

        The outputs keep their values. If the node has outputs and none of them is in use, nothing
        is done.

        Raises:
            DeviceError: If the node cannot be configured this way.
            LineFault: If it does not reply, or the bus fails.
        """
        from piezod_drivers.can_bus.cia401 import setup  # noqa: PLC0415 - `open` has imported it

        options, access = self._options, self._require_open()
        if self._reads_only:
            self._restart(())
            return
        pdos = []
        if self._output_numbers:
            pdos.append(setup.Pdo.for_outputs(options.rpdo, self._output_numbers))
        if self._expects_tpdo:
            read_back = self._output_numbers if self._reads_back_by_pdo else []
            pdos.append(setup.Pdo.for_inputs(options.tpdo, self._input_numbers, read_back))
        layouts = setup.prepare(access, pdos)
        self._rpdo = layouts.pop(0) if self._output_numbers else None
        self._tpdo = layouts.pop(0) if layouts else None
        self._tpdo_ids = frozenset({self._tpdo.id} if self._tpdo else ())
        if not self._tpdo_ids <= set(self._accepted()):
            what = f"the node's TPDO {options.tpdo} has identifier 0x{min(self._tpdo_ids):X}"
            raise DeviceError(f"{what}, which CiA 301 does not assign to it: set another tpdo")
        if self._watchdog:
            # Before START: the outputs must not run without the watchdog.
            setup.arm_watchdog(access, options.host_node, options.watchdog_ms, self._safe_codes)
        self._node_sends_heartbeats = setup.start_heartbeat(access, options.heartbeat_ms)
        access.send_nmt(objects.START)
        # Every heartbeat with the former state comes before the reply to this, and is dropped.
        access.read(objects.DEVICE_TYPE)
        self._restart((self._rpdo.id,) if self._rpdo else ())
        self._watchdog_armed = self._watchdog

    def deactivate(self) -> None:
        """Disarm the watchdog, so that the outputs hold.

        Raises:
            LineFault: If the node does not reply, or the bus fails.
        """
        from piezod_drivers.can_bus.cia401 import setup  # noqa: PLC0415 - `open` has imported it

        if self._watchdog_armed:
            self._watchdog_armed = self._watchdog_runs = False
            setup.disarm_watchdog(self._require_open())

    def sample(self, now_ns: int) -> Reading:
        """Send SYNC and read the inputs. Real-time safe.

        Raises:
            LineFault: If the node does not reply in time, or the bus fails.
        """
        if self._reads_only:
            return now_ns, self._values_of(read_words(self._conversation, self._read_inputs))
        return now_ns, self._sync([_SYNC], now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set the outputs and wait until the node confirms them. Real-time safe.

        Raises:
            LineFault: As `sample`, or `DEVICE_FAILURE` if an output reads back another value.
        """
        frame, words = self._output_frame(values)
        if self._expects_tpdo:
            self._sync([frame, _SYNC], None)
            return
        self._keep_alive()
        self._conversation.read_pending()
        self._conversation.tell(frame)
        if self._options.read_back == "none":
            # Nothing confirms the outputs themselves, so at least the node must be alive.
            self._require_heartbeat()
        elif (in_force := read_words(self._conversation, self._read_outputs)) != words:
            what = f"the outputs were set to codes {words} and read back as {in_force}"
            raise LineFault(DeviceFlag.DEVICE_FAILURE, what)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set the outputs and read the inputs. Real-time safe.

        Raises:
            LineFault: As `sample`.
        """
        frame, _ = self._output_frame(values)
        return now_ns, self._sync([frame, _SYNC], now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the value that each output is set to, as the node reports. Real-time safe.

        Raises:
            LineFault: As `sample`, or `WRONG_REQUEST` if the node refuses to report it.
        """
        # The exchange of this cycle has read them back already.
        if self._in_force_ns == now_ns:
            return self._in_force
        if self._reads_back_by_pdo and self._tpdo is not None:
            self._sync([_SYNC], now_ns)
            return self._in_force
        self._keep_alive()
        words = read_words(self._conversation, self._read_outputs)
        self._in_force = [
            s.value_of(word) for s, word in zip(self._output_scales, words, strict=True)
        ]
        self._in_force_ns = now_ns
        return self._in_force

    def flags(self) -> Sequence[Flags]:
        """Return the faults that the node reports, and which inputs are saturated."""
        common = self._health.flags
        if not common:
            return self._input_flags + [NO_FLAGS] * len(self._output_numbers)
        # A restart is reported for outputs only: it does not make a sample wrong.
        no_sensor = common - {DeviceFlag.RESTARTED}
        inputs = (
            [flags | no_sensor for flags in self._input_flags] if no_sensor else self._input_flags
        )
        return [*inputs, *[common] * len(self._output_numbers)]

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised."""
        return self._conversation.take_noticed()

    def _sync(self, frames: Sequence[Frame], now_ns: int | None) -> list[float]:
        layout = self._tpdo
        assert layout is not None  # noqa: S101 - SYNC is only sent if the node has a TPDO
        self._keep_alive()
        data = self._conversation.ask(frames, self._tpdo_ids, _is_plain)[layout.id]
        all_words = unpack(data, len(layout.fill))
        words = [all_words[position] for position in layout.positions]
        n_inputs = len(self._input_scales)
        if self._reads_back_by_pdo:
            read_back = zip(self._output_scales, words[n_inputs:], strict=True)
            self._in_force = [scale.value_of(word) for scale, word in read_back]
            self._in_force_ns = now_ns
        return self._values_of(words[:n_inputs])

    def _values_of(self, words: Sequence[int]) -> list[float]:
        values: list[float] = []
        flags: list[Flags] = []
        for scale, word in zip(self._input_scales, words, strict=True):
            value, is_at_an_end = scale.read(word)
            values.append(value)
            flags.append(_SATURATED if is_at_an_end else NO_FLAGS)
        self._input_flags = flags
        return values

    def _output_frame(self, values: Sequence[float]) -> tuple[Frame, list[int]]:
        layout = self._rpdo
        assert layout is not None  # noqa: S101 - a device without outputs is never written
        own = [
            scale.word_of(value) for scale, value in zip(self._output_scales, values, strict=True)
        ]
        if self._watchdog_armed and not self._watchdog_runs:
            # The node's watchdog starts with the first heartbeat, hence with the first setpoint.
            self._watchdog_runs, self._heartbeat_sent_ns = True, 0
        # Words of other outputs in the same PDO keep the values that they had in `activate`.
        words = list(layout.fill)
        for position, word in zip(layout.positions, own, strict=True):
            words[position] = word
        return Frame(layout.id, pack(words)), own

    def _keep_alive(self) -> None:
        """Send a heartbeat if it is due, and check that the node keeps its setup.

        Raises:
            LineFault: `DISCONNECTED` if the node has lost its setup.
        """
        if self._health.needs_setup:
            what = (
                "the node has restarted, or its watchdog has tripped: it must be configured again"
            )
            raise LineFault(DeviceFlag.DISCONNECTED, what)
        if self._watchdog_runs:
            now_ns = self._bus.now_ns()
            if now_ns - self._heartbeat_sent_ns >= self._heartbeat_period_ns:
                self._conversation.tell(self._heartbeat_frame)
                self._heartbeat_sent_ns = now_ns

    def _require_heartbeat(self) -> None:
        silent_ns = self._bus.now_ns() - self._node_heard_ns
        if (
            self._node_sends_heartbeats
            and silent_ns > _MISSED_HEARTBEATS * self._options.heartbeat_ms * MS
        ):
            what = f"no heartbeat from the node for {silent_ns // MS} ms"
            raise LineFault(DeviceFlag.LATE_REPLY, what)

    def _handle_frame(self, frame: Frame) -> None:
        if not frame.is_plain:
            return
        node = self._options.node
        if frame.id == objects.HEARTBEAT + node:
            self._node_heard_ns = self._bus.now_ns()
            self._health.take_heartbeat(frame.data)
        elif frame.id == objects.EMERGENCY + node:
            self._health.take_emergency(frame.data)

    def _restart(self, own: Sequence[int]) -> None:
        """Forget what happened before the setup; `own` are identifiers that only we send."""
        self._conversation = self._make_conversation(own)
        self._health.clear()
        self._watchdog_armed = self._watchdog_runs = False
        self._node_heard_ns = self._bus.now_ns()
        self._input_flags = [NO_FLAGS] * len(self._input_numbers)

    def _make_conversation(self, own: Sequence[int]) -> CanConversation:
        options = self._options
        ours = [objects.SDO_REQUEST + options.node, *own]
        if not self._reads_only:
            ours += [objects.NMT, objects.SYNC, objects.HEARTBEAT + options.host_node]
        return CanConversation(self._bus, round(options.timeout_ms * MS), ours, self._handle_frame)

    def _accepted(self) -> list[int]:
        node, host = self._options.node, self._options.host_node
        # Every identifier that CiA 301 predefines for the node: EMCY, PDOs, SDOs.
        all_of_node = [base + node for base in range(0x080, 0x800, 0x080)]
        return [objects.NMT, objects.SYNC, objects.HEARTBEAT + host, *all_of_node]

    def _frame_sizes(self) -> list[int]:
        """Return the number of data bytes of each frame of a cycle."""
        n_out = len(self._output_numbers)
        n_read = len(self._input_numbers) + (n_out if self._reads_back_by_pdo else 0)
        sizes = [2 * n_out] if n_out else []
        sizes += [0, 2 * n_read] if self._expects_tpdo else []  # SYNC has no data
        if self._reads_only:
            sizes += [SDO_BYTES, SDO_BYTES] * len(self._input_numbers)
        if self._options.read_back == "sdo":
            sizes += [SDO_BYTES, SDO_BYTES] * n_out
        return sizes

    def _require_open(self) -> SdoAccess:
        if self._sdo is None:
            raise DeviceError("the node is not open")
        return self._sdo


_SATURATED: Final[Flags] = frozenset({DeviceFlag.SATURATED})


def _is_plain(frame: Frame) -> bool:
    return not (frame.extended or frame.remote)  # `is_plain`, without the cost of another call


def _scale(at_min: int, at_max: int, values: tuple[float, float]) -> Scale:
    return Scale((at_min, at_max), values)
