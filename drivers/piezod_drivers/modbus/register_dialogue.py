"""The conversation with register maps: reads and writes blocks of registers."""

from collections.abc import Sequence
from math import isnan, nan
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue, StatusTurns
from piezod.devices.bus.bus_device import LOSING
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag, Flags
from piezod_drivers.modbus.blocks import ReadBlock, WriteBlock
from piezod_drivers.modbus.codec import set_coil
from piezod_drivers.modbus.layout import armed_watchdogs, make_layout, profile_of
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.setup import DeviceSetup
from piezod_drivers.modbus.transactions import Transactions

STATUS_PERIOD_NS: Final = 100_000_000
_HALF: Final = 0.5
SILENCE_NS: Final = 300_000_000
"""After a silence of this length the status is read before outputs are set.

A watchdog of unknown time-out may have tripped. The time is shorter if an armed watchdog waits for
less.
"""


class RegisterDialogue(BaseDialogue):
    """Implements `ExchangingDialogue` for the units of one line.

    Watchdogs are armed only for devices whose outputs are in use. If one has tripped, the outputs
    have changed. Then nothing is set until the device was opened again and its outputs were taken
    over at their present values.
    """

    def __init__(self, options: ModbusOptions, wiring: Wiring, transactions: Transactions) -> None:
        super().__init__(wiring, transactions, transactions)
        self._options, self._transactions = options, transactions
        self._layout = make_layout(options, wiring)
        self._ranges = self._layout.ranges
        self._watched = armed_watchdogs(options, wiring)
        wanted = options.watchdog if self._watched else None
        # 0.9 is a margin: after this silence the watchdog may trip before the next request arrives.
        armed_ns = round(0.9e9 * wanted.timeout_s) if wanted else SILENCE_NS
        self._silence_ns = min(SILENCE_NS, armed_ns)
        self._n_inputs = len(wiring.inputs)
        self._channels = {*wiring.inputs, *wiring.outputs}
        self._no_values = [nan] * len(wiring.inputs)
        self._status_flags = self._no_flags
        self._combined = self._layout.combined
        self._turns = StatusTurns(STATUS_PERIOD_NS)
        self._coil_levels: dict[int, bool] = {}  # as the device has acknowledged them
        self._coil_faults: dict[int, DeviceFlag] = {}
        self._coils_again_ns = 0
        self._last_ns = 0
        self._tripped = self._trip_lasts = False

    @property
    def exchanges(self) -> bool:
        """Whether one request sets and reads everything."""
        return bool(self._combined)

    def open(self) -> Identity:
        """Connect, identify every unit, and read everything once.

        Raises:
            DeviceError: If it is another device.
        """
        self._transactions.open()
        with self._transactions.opening():
            return self._identify_and_read()

    def _identify_and_read(self) -> Identity:
        identities = []
        for unit in self._options.every_unit:
            setup, profile = DeviceSetup(self._transactions, unit.unit), profile_of(unit)
            if profile is not None:
                setup.check_constants(profile, self._channels)
            identities.append(setup.read_identity(profile))
        self._status_flags = self._flags = self._no_flags
        self._coil_levels, self._coil_faults = {}, {}
        self._turns.restart()
        self._forget_in_force()
        reads = [self._try_forms(block) for block in self._layout.reads]
        if self._combined:
            # The combined requests have the same forms as the only read block.
            self._combined = [self._combined[form] for form in reads[0]]
        for block in (*self._layout.read_backs, *self._layout.statuses):
            self._try_forms(block)
        return Identity(*(" + ".join(parts) for parts in zip(*identities, strict=True)))

    def capabilities(self) -> Capabilities:
        """Return the channels and the highest rate of the line."""
        return self._layout.capabilities

    def activate(self) -> None:
        """Arm the watchdogs; the outputs keep their values.

        Raises:
            DeviceError: If one cannot be armed.
        """
        self._last_ns = self._transactions.now_ns()
        if (wanted := self._options.watchdog) is not None:
            for unit, plan in self._watched:
                DeviceSetup(self._transactions, unit).arm(plan, wanted.timeout_s, wanted.safe)
        self._tripped = self._trip_lasts = False
        if self._layout.status and self._layout.writes:
            self._transactions.settle()
            self._status_flags = self._flags = self._read_status()
            self._tripped = self._trip_lasts = self._reports_trip()

    def deactivate(self) -> None:
        """Stop the watchdogs that were armed; the outputs hold."""
        for unit, plan in self._watched:
            DeviceSetup(self._transactions, unit).disarm(plan)

    def sample(self, now_ns: int) -> Reading:
        """Read every input, and the status if it is due. Real-time safe."""
        values = self._no_values.copy()
        self._read(self._layout.reads, values)
        return self._reading(values, now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set every output; without inputs, also read the status if due. Real-time safe."""
        self._forget_in_force()
        began_ns = self._require_untripped()
        for block in self._layout.writes:
            self._write(block, values)
        # The instant before the requests, not of the replies: a watchdog's time runs from there.
        self._last_ns = began_ns
        # With inputs, `sample` reads the status.
        if not self._layout.reads:
            self._poll_status(began_ns)
        self._set_coils(values)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set and read everything in one request (function 23). Real-time safe."""
        self._forget_in_force()
        began_ns = self._require_untripped()
        write, block = self._layout.writes[0], self._layout.reads[0]
        words = write.words(values)
        requests = [form.request(words) for form in self._combined]
        pdu = self._transactions.ask(write.unit, requests, block.next_form())
        self._last_ns = began_ns
        measured = self._no_values.copy()
        block.decode(pdu, measured)
        self._set_coils(values)
        return self._reading(measured, now_ns)

    def flags(self) -> Sequence[Flags]:
        """Return the flags that the device reported last, and those of its coils."""
        flags = super().flags()
        if self._coil_faults:
            flags = list(flags)
            for position, flag in self._coil_faults.items():
                flags[self._n_inputs + position] |= {flag}
        return flags

    def _set_coils(self, values: Sequence[float]) -> None:
        """Set the coils whose level has changed, behind all voltages.

        One that is refused concerns no voltage: it has a flag, and is tried again after a while,
        because each try may last a time-out.

        Raises:
            LineFault: If the device is lost.
        """
        for unit, position, address in self._layout.coils:
            on = values[position] > _HALF
            if self._coil_levels.get(position) is on:
                continue
            now_ns = self._transactions.now_ns()
            if position in self._coil_faults and now_ns < self._coils_again_ns:
                continue
            try:
                self._transactions.ask(unit, [set_coil(address, on=on)])
            except LineFault as fault:
                self._coils_again_ns = now_ns + STATUS_PERIOD_NS
                self._coil_faults[position] = fault.flag
                self._coil_levels.pop(position, None)
                if fault.flag in LOSING:
                    raise
            else:
                self._coil_levels[position] = on
                self._coil_faults.pop(position, None)

    def _ask_in_force(self) -> list[float]:
        read_back = [nan] * len(self._ranges)
        self._read(self._layout.read_backs, read_back)
        return read_back

    def _try_forms(self, block: ReadBlock) -> list[int]:
        """Keep the forms of a block that the device accepts; return their indices."""
        taken = []
        for form, request in enumerate(block.requests):
            try:
                self._transactions.ask(block.unit, [request])
                taken.append(form)
            except LineFault as fault:
                # The first form reads only wanted registers; the others may reach beyond the
                # device's.
                if form == 0 or fault.flag is not DeviceFlag.WRONG_REQUEST:
                    raise
        block.keep_forms(taken)
        return taken

    def _read(self, blocks: Sequence[ReadBlock], into: list[float]) -> None:
        for block in blocks:
            pdu = self._transactions.ask(block.unit, block.requests, block.next_form())
            block.decode(pdu, into)

    def _write(self, block: WriteBlock, values: Sequence[float]) -> None:
        """Write by the best requests whose replies cannot be mistaken for a late one."""
        ways = block.requests(values)
        # Single requests are alternatives for one exchange. Otherwise a whole list is chosen,
        # because half of the outputs must not be written by one form and half by the other.
        if len(ways[0]) == 1 and all(len(way) == 1 for way in ways):
            self._transactions.ask(block.unit, [way[0] for way in ways])
            return
        for request in ways[0] if self._transactions.is_free(block.unit, ways[0]) else ways[-1]:
            self._transactions.ask(block.unit, [request])

    def _require_untripped(self) -> int:
        """Check that no watchdog has tripped; after a silence read the status first.

        Returns:
            The instant before this check; replies to later requests are newer.

        Raises:
            LineFault: If one has tripped: setting an output would now be a jump. `DISCONNECTED` if
                opening the device again may help.
        """
        began_ns = self._transactions.now_ns()
        silent = began_ns - self._last_ns > self._silence_ns
        if self._layout.status and (silent or self._trip_lasts):
            self._status_flags = self._flags = self._read_status()
        self._tripped |= self._reports_trip()
        if not self._tripped:
            return began_ns
        self._noticed.add(DeviceFlag.WATCHDOG_TRIPPED)
        what = "the watchdog has tripped and has changed the outputs"
        # Opening the device again helps only after its status has been cleared.
        self._trip_lasts &= self._reports_trip()
        if self._trip_lasts:
            what = f"{what}: clear its status first"
            raise LineFault(DeviceFlag.WATCHDOG_TRIPPED, what)
        raise LineFault(DeviceFlag.DISCONNECTED, f"{what}, which must be taken over again")

    def _reports_trip(self) -> bool:
        outputs = self._status_flags[self._n_inputs :]
        return any(DeviceFlag.WATCHDOG_TRIPPED in flags for flags in outputs)

    def _reading(self, values: list[float], now_ns: int) -> Reading:
        """Note saturated inputs, and read the status if it is due."""
        self._read_due_status(now_ns)
        self._flags = self._status_flags
        if saturated := [position for position, value in enumerate(values) if isnan(value)]:
            self._flags = flags = list(self._status_flags)
            for position in saturated:
                flags[position] |= {DeviceFlag.SATURATED}
        return now_ns, values

    def _poll_status(self, now_ns: int) -> None:
        """Read the status if it is due; a failure does not fail the write before it.

        Raises:
            LineFault: If the device is lost.
        """
        try:
            self._read_due_status(now_ns)
        except LineFault as fault:
            self._note_unless_lost(fault)
        self._flags = self._status_flags

    def _read_due_status(self, now_ns: int) -> None:
        if self._layout.status and self._turns.due(now_ns) is not None:
            self._status_flags = self._read_status()

    def _read_status(self) -> list[Flags]:
        numbers = [0.0] * len(self._layout.status)
        self._read(self._layout.statuses, numbers)
        found = list(self._no_flags)
        for (register, channels), number in zip(self._layout.status, numbers, strict=True):
            if register.flag is not None and int(number) & register.mask:
                for position in channels:
                    found[position] |= {register.flag}
        return found
