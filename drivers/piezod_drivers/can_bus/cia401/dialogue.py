"""The conversation with a CiA 401 node: PDOs and SYNC in the loop, SDO before it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.options import Cia401Options
from piezod_drivers.can_bus.cia401.sdo_words import SDO_BYTES, read_requests, read_words
from piezod_drivers.can_bus.cia401.supervision import MS, Supervision
from piezod_drivers.can_bus.cia401.wired_channels import WiredChannels
from piezod_drivers.can_bus.conversation import CanConversation
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus
from piezod_drivers.can_bus.options import max_rate_hz

if TYPE_CHECKING:
    from piezod_drivers.can_bus.cia401.process_data import PdoLayout
    from piezod_drivers.can_bus.cia401.sdo_client import SdoAccess

_SYNC: Final = Frame(objects.SYNC)


class Cia401Dialogue(BaseDialogue):
    """Implements `devices.bus.dialogue.ExchangingDialogue` for a CiA 401 node.

    One exchange is: process data with the outputs, SYNC, process data with the inputs. The node
    replies to the SYNC, which comes after the outputs, so this reply confirms them. If no input is
    in use, the node does not reply. Then reading back confirms the outputs or, if that is switched
    off, the node's heartbeat.

    If the node has outputs and none of them is in use, another program may drive it. Then the node
    is neither configured nor started, no SYNC is sent, and inputs are read by SDO.
    """

    def __init__(self, options: Cia401Options, wiring: Wiring, bus: FrameBus) -> None:
        with suppress(ImportError):  # now, because a node is opened again long after the start
            from piezod_drivers.can_bus.cia401 import process_data, setup  # noqa: F401, PLC0415
        self._supervision = Supervision(options, bus.now_ns)
        timeout_ns, take_frame = round(options.timeout_ms * MS), self._supervision.take_frame
        self._conversation = CanConversation(bus, timeout_ns, (), take_frame)
        super().__init__(wiring, bus, self._conversation)
        self._options, self._bus = options, bus
        self._channels = channels = WiredChannels(options, wiring)
        self._ranges = channels.ranges
        has_outputs = bool(channels.outputs)
        self._reads_back_by_pdo = options.read_back == "pdo" and has_outputs
        self._reads_only = channels.reads_only
        reads_inputs = bool(channels.inputs) and not self._reads_only
        self._expects_tpdo = reads_inputs or self._reads_back_by_pdo
        self._read_inputs = read_requests(options.node, objects.INPUT, channels.inputs)
        self._read_outputs = read_requests(options.node, objects.OUTPUT, channels.outputs)
        self._sdo: SdoAccess | None = None
        self._has_watchdog = False
        self._rpdo: PdoLayout | None = None
        self._tpdo: PdoLayout | None = None
        self._tpdo_ids: frozenset[int] = frozenset()

    def open(self) -> Identity:
        """Connect and identify the node; its outputs and its state stay as they are.

        Raises:
            DeviceUnavailableError: If it does not reply, or canopen is not installed.
            DeviceError: If it is no CiA 401 node.
        """
        try:
            from piezod_drivers.can_bus.cia401 import sdo_client, setup  # noqa: PLC0415 - optional
        except ImportError as error:
            what = f'the canopen library is missing ({error}): pip install "piezod[can]"'
            raise DeviceUnavailableError(what) from error
        options, node = self._options, self._options.node
        self._supervision.health.clear()
        self._rpdo = self._tpdo = None
        self._conversation.restart(self._own_ids())
        self._bus.open(self._accepted())
        access = self._sdo = sdo_client.SdoAccess(node, self._bus, self._supervision.take_frame)
        try:
            identity = setup.identify(access)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
            what = f"{fault}: check node number, power supply, bit rate and both terminations"
            raise DeviceUnavailableError(what) from fault
        for index, numbers in self._channels.read_by_sdo:
            setup.check_words(access, index, numbers)
        self._has_watchdog = setup.has_watchdog(access, self._channels.safe_codes)
        self._max_rate_hz = max_rate_hz(options.bus, self._frame_sizes())
        return identity

    def close(self) -> None:
        """Disconnect; the outputs keep their values. Never raises."""
        super().close()
        self._sdo = None

    def capabilities(self) -> Capabilities:
        """Return the channels, the highest rate, and whether the node has a watchdog."""
        return Capabilities(
            self._wiring.inputs,
            self._wiring.outputs,
            self._options.read_back != "none",
            self._max_rate_hz,
            holds=True,
            watchdog=self._has_watchdog,
        )

    def activate(self) -> None:
        """Configure the process data, arm the watchdog and start the node.

        The outputs keep their values. If the node has outputs and none of them is in use, nothing
        is done.

        Raises:
            DeviceError: If the node cannot be configured this way.
        """
        from piezod_drivers.can_bus.cia401 import process_data, setup  # noqa: PLC0415 - likewise

        options, access, channels = self._options, self._require_open(), self._channels
        if self._reads_only:
            self._conversation.restart(self._own_ids())
            channels.forget()
            self._supervision.restart()
            return
        pdos = []
        if channels.outputs:
            pdos.append(process_data.Pdo.for_outputs(options.rpdo, channels.outputs))
        if self._expects_tpdo:
            read_back = channels.outputs if self._reads_back_by_pdo else []
            pdos.append(process_data.Pdo.for_inputs(options.tpdo, channels.inputs, read_back))
        layouts = process_data.prepare(access, pdos)
        self._rpdo = layouts.pop(0) if channels.outputs else None
        self._tpdo = layouts.pop(0) if layouts else None
        self._tpdo_ids = frozenset((self._tpdo.id,)) if self._tpdo else frozenset()
        if self._tpdo and self._tpdo.id not in self._accepted():
            what = f"the node's TPDO {options.tpdo} has identifier 0x{self._tpdo.id:X}"
            raise DeviceError(f"{what}, which CiA 301 does not assign to it: set another tpdo")
        if self._has_watchdog:
            # Before START: the outputs must not run without the watchdog.
            host, codes = options.host_node, channels.safe_codes
            setup.arm_watchdog(access, host, options.watchdog_ms, codes)
        node_sends = setup.start_heartbeat(access, options.heartbeat_ms)
        access.send_nmt(objects.START)
        # Every heartbeat with the former state comes before the reply to this, and is dropped.
        access.read(objects.DEVICE_TYPE)
        self._conversation.restart(self._own_ids())
        channels.forget()
        self._supervision.restart(is_armed=self._has_watchdog, node_sends=node_sends)

    def deactivate(self) -> None:
        """Disarm the watchdog, so that the outputs hold."""
        from piezod_drivers.can_bus.cia401 import setup  # noqa: PLC0415 - `open` has imported it

        if self._supervision.is_armed:
            self._supervision.disarm()
            setup.disarm_watchdog(self._require_open(), self._options.host_node)

    def sample(self, now_ns: int) -> Reading:
        """Send SYNC and read the inputs. Real-time safe."""
        if self._reads_only:
            words = read_words(self._conversation, self._read_inputs)
            return now_ns, self._channels.measured(words)
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
        self._supervision.keep_alive(self._conversation.tell)
        self._conversation.read_pending()
        self._conversation.tell(frame)
        if self._options.read_back == "none":
            # Nothing confirms the outputs themselves, so at least the node must be alive.
            self._supervision.require_heartbeat()
        elif (in_force := read_words(self._conversation, self._read_outputs)) != words:
            what = f"the outputs were set to codes {words} and read back as {in_force}"
            raise LineFault(DeviceFlag.DEVICE_FAILURE, what)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set the outputs and read the inputs. Real-time safe."""
        frame, _ = self._output_frame(values)
        return now_ns, self._sync([frame, _SYNC], now_ns)

    def flags(self) -> Sequence[Flags]:
        """Return the faults that the node reports, and which inputs are saturated."""
        common, inputs = self._supervision.health.flags, self._channels.input_flags
        if not common:
            return inputs + [NO_FLAGS] * len(self._channels.outputs)
        # A restart is reported for outputs only: it does not make a sample wrong.
        if no_sensor := common - {DeviceFlag.RESTARTED}:
            inputs = [flags | no_sensor for flags in inputs]
        return [*inputs, *[common] * len(self._channels.outputs)]

    def _ask_in_force(self) -> Sequence[float]:
        """Return the value that each output is set to, as the node reports. Real-time safe.

        Raises:
            LineFault: As `sample`, or `WRONG_REQUEST` if the node refuses to report it.
        """
        if self._reads_back_by_pdo and self._tpdo is not None:
            self._sync([_SYNC], None)
            return self._in_force
        self._supervision.keep_alive(self._conversation.tell)
        return self._channels.in_force(read_words(self._conversation, self._read_outputs))

    def _sync(self, frames: Sequence[Frame], now_ns: int | None) -> list[float]:
        layout = self._tpdo
        assert layout is not None  # noqa: S101 - SYNC is only sent if the node has a TPDO
        self._supervision.keep_alive(self._conversation.tell)
        data = self._conversation.ask(frames, self._tpdo_ids, _is_plain)[layout.id]
        words = layout.words(data)
        n_inputs = len(self._channels.inputs)
        if self._reads_back_by_pdo:
            self._keep_in_force(self._channels.in_force(words[n_inputs:]), now_ns)
        return self._channels.measured(words[:n_inputs])

    def _output_frame(self, values: Sequence[float]) -> tuple[Frame, list[int]]:
        layout = self._rpdo
        assert layout is not None  # noqa: S101 - a device without outputs is never written
        own = self._channels.words_of(values)
        # The node's watchdog starts with the first heartbeat, hence with the first setpoint.
        self._supervision.start_watchdog()
        return layout.frame(own), own

    def _own_ids(self) -> list[int]:
        """Return the identifiers that only this host sends."""
        ours = [objects.SDO_REQUEST + self._options.node]
        if not self._reads_only:
            ours += [objects.NMT, objects.SYNC, objects.HEARTBEAT + self._options.host_node]
        return ours + ([self._rpdo.id] if self._rpdo else [])

    def _accepted(self) -> list[int]:
        host = objects.HEARTBEAT + self._options.host_node
        return [objects.NMT, objects.SYNC, host, *objects.predefined(self._options.node)]

    def _frame_sizes(self) -> list[int]:
        """Return the number of data bytes of each frame of a cycle."""
        n_out = len(self._channels.outputs)
        n_read = len(self._channels.inputs) + (n_out if self._reads_back_by_pdo else 0)
        sizes = [2 * n_out] if n_out else []
        sizes += [0, 2 * n_read] if self._expects_tpdo else []  # SYNC has no data
        if self._reads_only:
            sizes += [SDO_BYTES, SDO_BYTES] * len(self._channels.inputs)
        if self._options.read_back == "sdo":
            sizes += [SDO_BYTES, SDO_BYTES] * n_out
        return sizes

    def _require_open(self) -> SdoAccess:
        if self._sdo is None:
            raise DeviceError("the node is not open")
        return self._sdo


def _is_plain(frame: Frame) -> bool:
    return not (frame.extended or frame.remote)  # `is_plain`, without the cost of another call
