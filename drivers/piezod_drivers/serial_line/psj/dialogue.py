"""The conversation with an amplifier of piezosystem jena."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue, StatusTurns
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.player import AtEnd
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.player import Nv200Player
from piezod_drivers.serial_line.psj.profiles import PsjProfile
from piezod_drivers.serial_line.psj.reading_age import ReadingAge
from piezod_drivers.serial_line.psj.session import PsjSession
from piezod_drivers.serial_line.psj.setup import identity_of, limits_of
from piezod_drivers.serial_line.psj.takeover import take_over
from piezod_drivers.serial_line.psj.wave_requests import WaveRequests

STATUS_NS: Final = 100_000_000
"""Period in which the whole status is asked."""
BITS_PER_BYTE: Final = 10
STATUS_BYTES: Final = 24
"""Highest number of bytes of a status exchange, in both directions."""
_LOCAL: Final = frozenset({DeviceFlag.LOCAL_MODE})


class PsjDialogue(BaseDialogue):
    """Implements `Dialogue`; the amplifier is driven in open loop, in V.

    Outputs hold their voltage when control ends. Control is not returned to the front panel, whose
    knob may be at another voltage. A model that does not acknowledge a setpoint is read after it.

    Args:
        line: The line, not open.
        range_v: Lowest and highest voltage, in V.
        timeout_s: Longest wait for a reply, in s.
        remote: Whether the configuration confirms that an NV40 is under remote control.
        at_end: What the output does after a wave.

    Attributes:
        player: Plays tables on an NV200/D; None for the other models.
    """

    def __init__(
        self,
        line: Line,
        profile: PsjProfile,
        wiring: Wiring,
        range_v: tuple[float, float],
        timeout_s: float,
        *,
        remote: bool = False,
        at_end: AtEnd = AtEnd.UNKNOWN,
    ) -> None:
        self._session = PsjSession(line, profile, timeout_s)
        super().__init__(wiring, line, self._session.conversation)
        self._line, self._profile, self._range_v, self._remote = line, profile, range_v, remote
        # Channels are called ch0, ch1, ….
        self._inputs = [int(name[2:]) for name in wiring.inputs]
        self._outputs = [int(name[2:]) for name in wiring.outputs]
        self._channels = [int(name[2:]) for name in wiring.channels]
        self._reads_back = profile.reports_setpoint or profile.reads == "voltage"
        self._ages: list[ReadingAge] = []
        self._channel_flags: dict[int, Flags] = {}
        self._source_flags: dict[int, Flags] = {}
        self._reports_source = False
        self._turns = StatusTurns(STATUS_NS)
        self.player: Nv200Player | None = None
        if profile.plays and wiring.outputs:
            requests = WaveRequests(self._session, profile.baud)
            self.player = Nv200Player(self, requests, at_end)

    @property
    def wiring(self) -> Wiring:
        """The channels in use."""
        return self._wiring

    def open(self) -> Identity:
        """Connect, identify the device and read its limits; the outputs keep their values."""
        self._line.open()
        self._session.conversation.restart()
        if self.player is not None:
            self.player.forget()
        identity = identity_of(self._session, self._profile, self._line.where)
        self._ranges = [
            limits_of(self._session, self._profile, channel, self._range_v)
            for channel in self._outputs
        ]
        self._channel_flags = dict.fromkeys(self._channels, NO_FLAGS)
        self._source_flags = dict.fromkeys(self._channels, NO_FLAGS)
        self._ages = [ReadingAge(round(self._profile.refresh_s * 1e9)) for _ in self._inputs]
        self._session.conversation.forget_noticed()
        return identity

    def capabilities(self) -> Capabilities:
        """Return the channels and the highest rate that the bit rate allows."""
        return Capabilities(
            inputs=self._wiring.inputs,
            outputs=self._wiring.outputs,
            read_back=self._reads_back,
            max_rate_hz=self._profile.baud
            / BITS_PER_BYTE
            / (self._bytes_per_cycle() + STATUS_BYTES),
            holds=True,
        )

    def activate(self) -> None:
        """Check that the outputs can be driven from their present voltages; see `takeover`.

        A play that is found is stopped before.

        Raises:
            DeviceError: If that is impossible without a jump.
        """
        self._forget_in_force()
        if self.player is not None:
            self.player.stop_found()
        self._reports_source = take_over(
            self._profile, self._outputs, self._session, remote=self._remote
        )
        for _ in range(self._n_turns()):
            self._turns.restart()
            self._poll_status()
        self._session.conversation.forget_noticed()

    def sample(self, now_ns: int) -> Reading:
        """Read every input, in µm, with the instant of its last refresh. Real-time safe."""
        values, t_ns = [], now_ns
        for channel, age in zip(self._inputs, self._ages, strict=True):
            value = codec.number(self._session.value(self._profile.read, channel))
            values.append(value)
            # A sample is as old as the oldest of its values.
            t_ns = min(t_ns, age.taken_ns(value, now_ns))
        self._poll_status()
        return t_ns, values

    def put(self, values: Sequence[float]) -> None:
        """Set every output, in V; read outputs that do not acknowledge. Real-time safe.

        The voltage that an NV40/1 reports is measured and follows the setpoint later. The read-back
        watch checks that it does.
        """
        self._forget_in_force()
        profile = self._profile
        for channel, value in zip(self._outputs, values, strict=True):
            if profile.acknowledges:
                self._session.ask(profile.set, channel, value)
            else:
                self._session.tell(profile.set, channel, value)
                codec.number(self._session.value(profile.read, channel))
        self._poll_status()

    def flags(self) -> Sequence[Flags]:
        """Return the last status of each channel. Real-time safe."""
        reported, source = self._channel_flags, self._source_flags
        of_inputs = [reported[channel] for channel in self._inputs]
        return of_inputs + [reported[channel] | source[channel] for channel in self._outputs]

    def _bytes_per_cycle(self) -> int:
        """Return the highest number of bytes of a cycle, both ways, without the status."""
        profile = self._profile
        # A setpoint of the largest length, and its acknowledgement: XOFF and XON.
        setpoint = len(codec.command(profile, profile.set, 0, -100.0)) + len(b"\x13\x11")
        asked = len(codec.command(profile, profile.read, 0))
        answer = asked + len(b"\x13,-100.0000\r\n\x11")
        n_reads = len(self._inputs)
        if self._reads_back or not profile.acknowledges:
            n_reads += len(self._outputs)
        return len(self._outputs) * setpoint + n_reads * (asked + answer)

    def _ask_in_force(self) -> Sequence[float]:
        """Return the setpoints or the voltages, in V. Real-time safe."""
        name = self._profile.set if self._profile.reports_setpoint else self._profile.read
        return [codec.number(self._session.value(name, channel)) for channel in self._outputs]

    def _poll_status(self) -> None:
        """Read one part of the status if it is due; never before a setpoint."""
        turn = self._turns.due(self._line.now_ns(), self._n_turns())
        if turn is None:
            return
        try:
            self._ask_status(turn)
        except LineFault as fault:
            self._note_unless_lost(fault)

    def _n_turns(self) -> int:
        """Return the number of exchanges that read the whole status."""
        if not self._profile.status:
            return 0
        if self._profile.status_per_channel:
            return len(self._channels)
        return 1 + (len(self._outputs) if self._reports_source else 0)

    def _ask_status(self, turn: int) -> None:
        profile = self._profile
        if not profile.status_per_channel:
            self._ask_common_status(turn)
            return
        channel = self._channels[turn]
        status = codec.word(self._session.value(profile.status, channel), 10)
        self._channel_flags[channel] = codec.flags_of(status, profile.status_bits)

    def _ask_common_status(self, turn: int) -> None:
        """Read the status of all channels, or in a later turn the source of one voltage."""
        profile = self._profile
        if turn > 0:
            channel = self._outputs[turn - 1]
            remote = self._session.is_remote(channel)
            self._source_flags[channel] = NO_FLAGS if remote else _LOCAL
            return
        words = self._session.values(profile.status, None, profile.channels)
        for channel in self._channels:
            status = codec.word(words[channel], 16)
            self._channel_flags[channel] = codec.flags_of(status, profile.status_bits)
