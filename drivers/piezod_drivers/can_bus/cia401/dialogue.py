"""What goes over the bus to a CiA 401 node: process data and SYNC in the loop, SDO around it."""

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
from piezod_drivers.can_bus.cia401.sdo_words import SDO_BYTES, read_words, requests_for
from piezod_drivers.can_bus.conversation import CanCycle
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus
from piezod_drivers.can_bus.options import highest_rate_hz

if TYPE_CHECKING:
    from piezod_drivers.can_bus.cia401.sdo_client import SdoAccess
    from piezod_drivers.can_bus.cia401.setup import PdoLayout

MS: Final = 1_000_000
_BEATS: Final = 4
"""So often the host shows that it lives, in the time that the node waits for it."""
_MISSED: Final = 3
"""A node is silent when so many of its heartbeats have not come."""
_SYNC: Final = Frame(objects.SYNC)


class Cia401Dialogue:
    """Implements `devices.bus.dialogue.ExchangingDialogue` for a node of CiA 401.

    One exchange is: process data with the outputs, SYNC, process data with the inputs. It is the
    node's answer to the SYNC, sent after the outputs, that acknowledges them. A node of which no
    input is used does not answer; there, outputs are acknowledged by reading them back, or, where
    that is switched off, by the node's heartbeat.

    Where the node has outputs and none of them is used, inputs are read by SDO: somebody else may
    drive it, so that it is not set up, nor started, and no SYNC is sent.

    Args:
        options: What a configuration says.
        wiring: The channels that are used.
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
        self._safe = [(c.number, c.safe_code) for c in outputs if c.safe_code is not None]
        self._by_pdo = options.read_back == "pdo" and bool(outputs)
        self._only_looks = bool(options.outputs) and not outputs
        self._asks = (bool(inputs) and not self._only_looks) or self._by_pdo
        node = options.node
        self._read_inputs = requests_for(node, objects.INPUT, self._input_numbers)
        self._read_outputs = requests_for(node, objects.OUTPUT, self._output_numbers)
        self._beat_frame = Frame(
            objects.HEARTBEAT + options.host_node, bytes((objects.OPERATIONAL,))
        )
        self._health = NodeHealth()
        self._access: SdoAccess | None = None
        self._watchdog = self._armed = self._watched = self._beats = False
        self._beat_ns = self._heard_ns = 0
        self._beat_every_ns = options.watchdog_ms * MS // _BEATS
        self._in_force: list[float] = []
        self._in_force_ns: int | None = None
        self._input_flags: list[Flags] = []
        self._cycle = self._make_cycle(())
        self._set: PdoLayout | None = None
        self._tell: PdoLayout | None = None
        self._told: frozenset[int] = frozenset()

    def open(self) -> Identity:
        """Connect, and ask the node who it is; its outputs and its state stay as they are.

        Raises:
            DeviceUnavailableError: If it does not answer, or canopen is not installed.
            DeviceError: If it is no CiA 401 node.
            LineFault: If the bus fails.
        """
        try:
            from piezod_drivers.can_bus.cia401 import (  # noqa: PLC0415 - optional
                sdo_client,
                setup,
            )
        except ImportError as error:
            what = f'the canopen library is needed ({error}): pip install "piezod[can]"'
            raise DeviceUnavailableError(what) from error
        options, node = self._options, self._options.node
        self._health.clear()
        self._cycle, self._tell = self._make_cycle(()), None
        self._bus.open(self._accepted())
        access = self._access = sdo_client.SdoAccess(node, self._bus, self._take)
        try:
            identity = setup.identify(access)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
            what = f"{fault}: check its number, its supply, the bit rate and both terminations"
            raise DeviceUnavailableError(what) from fault
        self._watchdog = bool(self._safe) and all(
            setup.has(access, *needed)
            for number, _ in self._safe
            for needed in ((objects.ERROR_VALUE, number), (objects.CONSUMER_HEARTBEAT, 1))
        )
        self._max_rate_hz = highest_rate_hz(options.bus, self._sizes())
        return identity

    def close(self) -> None:
        """Let go of the bus; outputs stay as they are. Never raises."""
        self._bus.close()
        self._access = None

    def capabilities(self) -> Capabilities:
        """Tell what the node can do."""
        return Capabilities(
            self._wiring.inputs,
            self._wiring.outputs,
            self._options.read_back != "none",
            self._max_rate_hz,
            holds=True,
            watchdog=self._watchdog,
        )

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell the ranges of the outputs, as configured."""
        return self._ranges

    def activate(self) -> None:
        """Set the node's process data up, arm its watchdog and start it; outputs stay as they are.

        Where the node has outputs and none of them is used, nothing of that is done.

        Raises:
            DeviceError: If the node cannot be set up so.
            LineFault: If it does not answer, or the bus fails.
        """
        from piezod_drivers.can_bus.cia401 import setup  # noqa: PLC0415 - `open` has imported it

        options, access = self._options, self._require()
        if self._only_looks:
            self._begin(())
            return
        pdos = []
        if self._output_numbers:
            pdos.append(setup.Pdo.sets(options.rpdo, self._output_numbers))
        if self._asks:
            told = self._output_numbers if self._by_pdo else []
            pdos.append(setup.Pdo.tells(options.tpdo, self._input_numbers, told))
        layouts = setup.prepare(access, pdos)
        self._set = layouts.pop(0) if self._output_numbers else None
        self._tell = layouts.pop(0) if layouts else None
        self._told = frozenset({self._tell.id} if self._tell else ())
        if not self._told <= set(self._accepted()):
            what = f"the node's TPDO {options.tpdo} has identifier 0x{min(self._told):X}"
            raise DeviceError(f"{what}, which is none that CiA 301 gives it: name another tpdo")
        if self._watchdog:
            setup.arm(access, options.host_node, options.watchdog_ms, self._safe)
        self._beats = setup.beat(access, options.heartbeat_ms)
        access.order(objects.START)
        access.read(objects.DEVICE_TYPE)  # what the node said of its state before comes before this
        self._begin((self._set.id,) if self._set else ())
        self._armed = self._watchdog

    def deactivate(self) -> None:
        """Disarm the watchdog, so that the outputs hold.

        Raises:
            LineFault: If the node does not answer, or the bus fails.
        """
        from piezod_drivers.can_bus.cia401 import setup  # noqa: PLC0415 - `open` has imported it

        if self._armed:
            self._armed = self._watched = False
            setup.disarm(self._require())

    def sample(self, now_ns: int) -> Reading:
        """Send SYNC and take the inputs; may be called in the loop.

        Raises:
            LineFault: If the node does not answer in time, or the bus fails.
        """
        if self._only_looks:
            return now_ns, self._measured(read_words(self._cycle, self._read_inputs))
        return now_ns, self._ask([_SYNC], now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set the outputs, and wait until the node shows that it has them; in the loop too.

        Raises:
            LineFault: As `sample`, or `DEVICE_FAILURE` if an output is set to another value.
        """
        frame, words = self._outputs(values)
        if self._asks:
            self._ask([frame, _SYNC], None)
            return
        self._keep_alive()
        self._cycle.catch_up()
        self._cycle.tell(frame)
        if self._options.read_back == "none":
            self._require_heartbeat()
        elif (in_force := read_words(self._cycle, self._read_outputs)) != words:
            what = f"outputs were set to codes {words} and are at {in_force}"
            raise LineFault(DeviceFlag.DEVICE_FAILURE, what)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set the outputs and take the inputs; may be called in the loop.

        Raises:
            LineFault: As `sample`.
        """
        frame, _ = self._outputs(values)
        return now_ns, self._ask([frame, _SYNC], now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Tell what the node says its outputs are set to; may be called in the loop.

        Raises:
            LineFault: As `sample`, or `WRONG_REQUEST` if the node refuses to tell.
        """
        if self._in_force_ns == now_ns:
            return self._in_force
        if self._by_pdo and self._tell is not None:
            self._ask([_SYNC], now_ns)
            return self._in_force
        self._keep_alive()
        words = read_words(self._cycle, self._read_outputs)
        self._in_force = [
            s.value_of(word) for s, word in zip(self._output_scales, words, strict=True)
        ]
        self._in_force_ns = now_ns
        return self._in_force

    def flags(self) -> Sequence[Flags]:
        """Tell what the node has said of itself, and which inputs are at their end."""
        common = self._health.flags
        if not common:
            return self._input_flags + [NO_FLAGS] * len(self._output_numbers)
        no_sensor = common - {DeviceFlag.RESTARTED}
        inputs = (
            [flags | no_sensor for flags in self._input_flags] if no_sensor else self._input_flags
        )
        return [*inputs, *[common] * len(self._output_numbers)]

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail."""
        return self._cycle.take_noticed()

    def _ask(self, frames: Sequence[Frame], now_ns: int | None) -> list[float]:
        layout = self._tell
        assert layout is not None  # noqa: S101 - where nothing is told nobody asks
        self._keep_alive()
        data = self._cycle.ask(frames, self._told, _is_plain)[layout.id]
        told = unpack(data, len(layout.fill))
        words = [told[place] for place in layout.places]
        n_inputs = len(self._input_scales)
        if self._by_pdo:
            set_to = zip(self._output_scales, words[n_inputs:], strict=True)
            self._in_force = [scale.value_of(word) for scale, word in set_to]
            self._in_force_ns = now_ns
        return self._measured(words[:n_inputs])

    def _measured(self, words: Sequence[int]) -> list[float]:
        values: list[float] = []
        flags: list[Flags] = []
        for scale, word in zip(self._input_scales, words, strict=True):
            value, is_at_an_end = scale.read(word)
            values.append(value)
            flags.append(_SATURATED if is_at_an_end else NO_FLAGS)
        self._input_flags = flags
        return values

    def _outputs(self, values: Sequence[float]) -> tuple[Frame, list[int]]:
        layout = self._set
        assert layout is not None  # noqa: S101 - where there are no outputs nobody writes
        own = [
            scale.word_of(value) for scale, value in zip(self._output_scales, values, strict=True)
        ]
        if self._armed and not self._watched:
            # The node watches from the first heartbeat on: not before somebody drives.
            self._watched, self._beat_ns = True, 0
        words = list(layout.fill)
        for place, word in zip(layout.places, own, strict=True):
            words[place] = word
        return Frame(layout.id, pack(words)), own

    def _keep_alive(self) -> None:
        """Show that this host lives, if it is time; and be sure that the node is as it was set up.

        Raises:
            LineFault: `DISCONNECTED` if it is not.
        """
        if self._health.must_be_set_up:
            what = (
                "the node has started anew, or its watchdog has tripped: it has to be set up again"
            )
            raise LineFault(DeviceFlag.DISCONNECTED, what)
        if self._watched:
            now_ns = self._bus.now_ns()
            if now_ns - self._beat_ns >= self._beat_every_ns:
                self._cycle.tell(self._beat_frame)
                self._beat_ns = now_ns

    def _require_heartbeat(self) -> None:
        silent_ns = self._bus.now_ns() - self._heard_ns
        if self._beats and silent_ns > _MISSED * self._options.heartbeat_ms * MS:
            what = f"no heartbeat from the node for {silent_ns // MS} ms"
            raise LineFault(DeviceFlag.LATE_REPLY, what)

    def _take(self, frame: Frame) -> None:
        if not frame.is_plain:
            return
        node = self._options.node
        if frame.id == objects.HEARTBEAT + node:
            self._heard_ns = self._bus.now_ns()
            self._health.take_heartbeat(frame.data)
        elif frame.id == objects.EMERGENCY + node:
            self._health.take_emergency(frame.data)

    def _begin(self, own: Sequence[int]) -> None:
        """Forget what was before the node was set up; identifiers of `own` are only ours."""
        self._cycle = self._make_cycle(own)
        self._health.clear()
        self._armed = self._watched = False
        self._heard_ns = self._bus.now_ns()
        self._input_flags = [NO_FLAGS] * len(self._input_numbers)

    def _make_cycle(self, own: Sequence[int]) -> CanCycle:
        options = self._options
        ours = [objects.SDO_REQUEST + options.node, *own]
        if not self._only_looks:
            ours += [objects.NMT, objects.SYNC, objects.HEARTBEAT + options.host_node]
        return CanCycle(self._bus, round(options.timeout_ms * MS), ours, self._take)

    def _accepted(self) -> list[int]:
        node, host = self._options.node, self._options.host_node
        all_of_node = [base + node for base in range(0x080, 0x800, 0x080)]
        return [objects.NMT, objects.SYNC, objects.HEARTBEAT + host, *all_of_node]

    def _sizes(self) -> list[int]:
        """Return the bytes of each frame of a cycle."""
        n_out = len(self._output_numbers)
        told = len(self._input_numbers) + (n_out if self._by_pdo else 0)
        sizes = [2 * n_out] if n_out else []
        sizes += [0, 2 * told] if self._asks else []
        if self._only_looks:
            sizes += [SDO_BYTES, SDO_BYTES] * len(self._input_numbers)
        if self._options.read_back == "sdo":
            sizes += [SDO_BYTES, SDO_BYTES] * n_out
        return sizes

    def _require(self) -> SdoAccess:
        if self._access is None:
            raise DeviceError("the node is not open")
        return self._access


_SATURATED: Final[Flags] = frozenset({DeviceFlag.SATURATED})


def _is_plain(frame: Frame) -> bool:
    return not (frame.extended or frame.remote)  # what `is_plain` is, without one call more


def _scale(at_min: int, at_max: int, values: tuple[float, float]) -> Scale:
    return Scale((at_min, at_max), values)
