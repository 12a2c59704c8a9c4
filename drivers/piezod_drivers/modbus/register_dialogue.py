"""The driver for register maps: reads and writes blocks of registers."""

from collections.abc import Sequence
from math import isnan, nan
from typing import Final

from piezod.devices.bus.bus_device import LOSING
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.modbus.blocks import ReadBlock, WriteBlock
from piezod_drivers.modbus.layout import lay_out, profile_of, watched
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.setup import Setup
from piezod_drivers.modbus.transactions import Transactions

STATUS_PERIOD_NS: Final = 100_000_000
SILENCE_NS: Final = 300_000_000
"""After so long a watchdog may have tripped: the device is asked before outputs are set.

Sooner where one is armed that waits for less."""


class RegisterDialogue:
    """Implements `ExchangingDialogue` for the units of one line.

    Watchdogs are armed only where outputs are used. Where one has tripped, outputs are not where
    they were, and nothing is set until somebody opens the device again and takes them over there.

    Args:
        options: What a configuration says.
        wiring: The channels that are used.
        transactions: The line.
    """

    def __init__(self, options: ModbusOptions, wiring: Wiring, transactions: Transactions) -> None:
        self._options, self._transactions = options, transactions
        self._layout = lay_out(options, wiring)
        self._watched = watched(options, wiring)
        wanted = options.watchdog if self._watched else None
        armed_ns = round(0.9e9 * wanted.timeout_s) if wanted else SILENCE_NS
        self._silence_ns = min(SILENCE_NS, armed_ns)
        self._n_inputs = len(wiring.inputs)
        self._no_values = [nan] * len(wiring.inputs)
        self._well: list[Flags] = [NO_FLAGS] * len((*wiring.inputs, *wiring.outputs))
        self._said = self._told = self._well
        self._together = self._layout.together
        self._status_ns: int | None = None
        self._last_ns = 0
        self._tripped = self._lasts = False
        self._noticed: set[DeviceFlag] = set()
        self._in_force: Sequence[float] = ()
        self._in_force_ns: int | None = None

    @property
    def exchanges(self) -> bool:
        """Whether everything is set and read in one request."""
        return bool(self._together)

    def open(self) -> Identity:
        """Connect, see whether every unit is what it should be, and read everything once.

        Raises:
            DeviceUnavailableError: If nobody is there.
            DeviceError: If it is another device.
            LineFault: If an exchange fails.
        """
        self._transactions.open()
        identities = []
        for unit in self._options.every_unit:
            setup, profile = Setup(self._transactions, unit.unit), profile_of(unit)
            if profile is not None:
                setup.check(profile)
            identities.append(setup.identity(profile))
        self._said = self._told = self._well
        self._status_ns = self._in_force_ns = None
        reads = [self._try_forms(block) for block in self._layout.reads]
        if self._together:
            self._together = [self._together[form] for form in reads[0]]
        for block in (*self._layout.backs, *self._layout.statuses):
            self._try_forms(block)
        return Identity(*(" + ".join(parts) for parts in zip(*identities, strict=True)))

    def close(self) -> None:
        """Let go of the line; outputs stay as they are. Never raises."""
        self._transactions.close()

    def capabilities(self) -> Capabilities:
        """Tell channels and the rate that the line allows."""
        return self._layout.able

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell what each output can be set to."""
        return self._layout.ranges

    def activate(self) -> None:
        """Arm the watchdogs; outputs stay where they are.

        Raises:
            DeviceError: If one cannot be armed.
            LineFault: If an exchange fails.
        """
        self._last_ns = self._transactions.now_ns()
        if (wanted := self._options.watchdog) is not None:
            for unit, plan in self._watched:
                Setup(self._transactions, unit).arm(plan, wanted.timeout_s, wanted.safe)
        self._tripped = self._lasts = False
        if self._layout.status and self._layout.writes:
            self._transactions.settle()
            self._said = self._told = self._read_status()
            self._tripped = self._lasts = self._says_tripped()

    def deactivate(self) -> None:
        """Stop the watchdogs that were armed; outputs hold.

        Raises:
            LineFault: If an exchange fails.
        """
        for unit, plan in self._watched:
            Setup(self._transactions, unit).disarm(plan)

    def sample(self, now_ns: int) -> Reading:
        """Read every input, and the status now and then; may be called in the loop."""
        values = self._no_values.copy()
        self._read(self._layout.reads, values)
        return self._noted(values, now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set every output; without inputs, read the status now and then; call it in the loop."""
        self._in_force_ns = None
        began_ns = self._require_untripped()
        for block in self._layout.writes:
            self._write(block, values)
        self._last_ns = began_ns  # whoever is stopped before the reply has been silent since
        if not self._layout.reads:
            self._look_around(began_ns)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set and read everything in one request (function 23); may be called in the loop."""
        self._in_force_ns = None
        began_ns = self._require_untripped()
        write, block = self._layout.writes[0], self._layout.reads[0]
        words = write.words(values)
        requests = [form.request(words) for form in self._together]
        pdu = self._transactions.ask(write.unit, requests, block.turn())
        self._last_ns = began_ns
        measured = self._no_values.copy()
        block.decode(pdu, measured)
        return self._noted(measured, now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Read the outputs back; may be called in the loop."""
        if self._in_force_ns != now_ns:
            told = [nan] * len(self._layout.ranges)
            self._read(self._layout.backs, told)
            self._in_force, self._in_force_ns = told, now_ns
        return self._in_force

    def flags(self) -> Sequence[Flags]:
        """Tell what the devices have said last; may be called in the loop."""
        return self._told

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong on the line without making an exchange fail."""
        noticed = self._transactions.take_noticed() | self._noticed
        self._noticed = set()
        return noticed

    def _try_forms(self, block: ReadBlock) -> list[int]:
        """Keep the forms of a question that the device takes; return their places."""
        taken = []
        for form, request in enumerate(block.requests):
            try:
                self._transactions.ask(block.unit, [request])
                taken.append(form)
            except LineFault as fault:
                if form == 0 or fault.flag is not DeviceFlag.WRONG_REQUEST:
                    raise
        block.keep(taken)
        return taken

    def _read(self, blocks: Sequence[ReadBlock], into: list[float]) -> None:
        for block in blocks:
            pdu = self._transactions.ask(block.unit, block.requests, block.turn())
            block.decode(pdu, into)

    def _write(self, block: WriteBlock, values: Sequence[float]) -> None:
        """Write in the best way whose acknowledgement cannot be mistaken for a late one."""
        ways = block.requests(values)
        if len(ways[0]) == 1 and all(len(way) == 1 for way in ways):
            self._transactions.ask(block.unit, [way[0] for way in ways])
            return
        for request in ways[0] if self._transactions.is_free(block.unit, ways[0]) else ways[-1]:
            self._transactions.ask(block.unit, [request])

    def _require_untripped(self) -> int:
        """Be sure that no watchdog has tripped; ask, where nobody was heard for long.

        Returns:
            When that began: whoever acknowledges what is asked next was heard since.

        Raises:
            LineFault: If one has: to set an output now would be a jump. `DISCONNECTED` where to
                open the device again may help.
        """
        began_ns = self._transactions.now_ns()
        silent = began_ns - self._last_ns > self._silence_ns
        if self._layout.status and (silent or self._lasts):
            self._said = self._told = self._read_status()
        self._tripped |= self._says_tripped()
        if not self._tripped:
            return began_ns
        self._noticed.add(DeviceFlag.WATCHDOG_TRIPPED)
        what = "the watchdog has tripped: the outputs are not where they were"
        self._lasts &= self._says_tripped()
        if self._lasts:
            what = f"{what}, and its status has to be cleared first"
            raise LineFault(DeviceFlag.WATCHDOG_TRIPPED, what)
        raise LineFault(DeviceFlag.DISCONNECTED, f"{what}, and have to be taken over again")

    def _says_tripped(self) -> bool:
        outputs = self._said[self._n_inputs :]
        return any(DeviceFlag.WATCHDOG_TRIPPED in flags for flags in outputs)

    def _noted(self, values: list[float], now_ns: int) -> Reading:
        """Note saturated inputs, and ask for the status where it is due."""
        self._ask_status(now_ns)
        self._told = self._said
        if nan_at := [place for place, value in enumerate(values) if isnan(value)]:
            self._told = list(self._said)
            for place in nan_at:
                self._told[place] |= {DeviceFlag.SATURATED}
        return now_ns, values

    def _look_around(self, now_ns: int) -> None:
        """Ask for the status where it is due; outputs are set, whatever becomes of that.

        Raises:
            LineFault: If the device is lost.
        """
        try:
            self._ask_status(now_ns)
        except LineFault as fault:
            if fault.flag in LOSING:
                raise
            self._noticed.add(fault.flag)
        self._told = self._said

    def _ask_status(self, now_ns: int) -> None:
        if self._layout.status and (
            self._status_ns is None or now_ns - self._status_ns >= STATUS_PERIOD_NS
        ):
            self._status_ns = now_ns
            self._said = self._read_status()

    def _read_status(self) -> list[Flags]:
        numbers = [0.0] * len(self._layout.status)
        self._read(self._layout.statuses, numbers)
        said = list(self._well)
        for (register, channels), number in zip(self._layout.status, numbers, strict=True):
            if register.flag is not None and int(number) & register.mask:
                for place in channels:
                    said[place] |= {register.flag}
        return said
