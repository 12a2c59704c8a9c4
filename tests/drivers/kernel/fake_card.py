"""A converter card in memory, in virtual time: input n measures output n, also by commands."""

import errno
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from piezod.devices.bus.line import LineFault
from piezod.errors import DeviceUnavailableError
from piezod_drivers.kernel.comedi import library as names
from piezod_drivers.kernel.comedi.card import Pin, Timing
from piezod_drivers.kernel.comedi.codec import Converter, Polynomial
from piezod_drivers.kernel.comedi.options import ComediOptions
from piezod_drivers.kernel.errno_faults import fault_of

MOST = 65_535
SPAN_V = 20.0
STEP_V = SPAN_V / MOST
STEP_NS = 1000
BUFFER_BYTES = 65_536
CONVERTER = Converter(
    Polynomial((-10.0, STEP_V)), Polynomial((0.0, 1.0 / STEP_V), origin=-10.0), MOST
)
OPTIONS = ComediOptions.model_validate(
    {
        "inputs": {"position": {"number": 0}},
        "outputs": {"drive": {"number": 0, "measured_by": {"number": 0}}},
        "digital_inputs": {"camera": {"number": 4}},
        "digital_outputs": {"pixel": {"number": 0}, "frame": {"number": 1}},
    }
)
INPUTS, OUTPUTS, LINES = 0, 1, 2
"""Subdevices."""


@dataclass
class Running:
    """A command."""

    pins: list[Pin]
    timing: Timing
    start_ns: int | None = None
    n_done: int = 0
    failed: bool = False

    @property
    def runs(self) -> bool:
        """Whether it is not at its end."""
        return not self.failed and self.n_done < self.timing.n_scans


@dataclass
class FakeCard:
    """Implements `Card`."""

    refuses: int = 0  #: Error number of every call; 0 for none.
    locked_by_other: bool = False
    has_commands: bool = True
    now_ns: int = 1_000_000_000
    is_open: bool = False
    codes: dict[int, int] = field(default_factory=lambda: {0: MOST // 2, 1: MOST // 2})
    levels: dict[int, int] = field(default_factory=dict)  #: Of the digital lines.
    driven: set[int] = field(default_factory=set)  #: Lines that are outputs.
    commands: dict[int, Running] = field(default_factory=dict)
    written: list[tuple[int, int]] = field(default_factory=list)
    _queue: deque[int] = field(default_factory=deque)
    _sampled: bytearray = field(default_factory=bytearray)

    def open(self) -> tuple[str, str, str]:
        if self.refuses:
            raise DeviceUnavailableError("no card")
        self.is_open = True
        return "fake", "fake card", "0.7.76"

    def close(self) -> None:
        self.is_open = False
        self.commands.clear()

    def subdevice(self, kind: int) -> int:
        return {names.INPUTS: INPUTS, names.OUTPUTS: OUTPUTS}[kind]

    def flags(self, subdevice: int) -> int:
        self._check()
        command = self.commands.get(subdevice)
        able = (names.COMMAND_WRITE, names.COMMAND_READ)[subdevice == INPUTS]
        runs = command is not None and command.start_ns is not None and command.runs
        return (able if self.has_commands else 0) | (names.RUNNING if runs else 0)

    def pin(self, subdevice: int, number: int, volts: tuple[float, float], reference: int) -> Pin:  # noqa: ARG002 - the interface's
        return Pin(subdevice, number, 0, reference)

    def line(self, number: int, subdevice: int | None, *, driven: bool) -> Pin:  # noqa: ARG002 - the interface's
        self.levels.setdefault(number, 0)
        return Pin(LINES, number, 0, 0)

    def direct(self, outputs: Sequence[Pin], inputs: Sequence[Pin]) -> None:  # noqa: ARG002 - the interface's
        self._check()
        self.driven |= {pin.number for pin in outputs}

    def converter(self, pin: Pin, calibration: str | None) -> Converter:  # noqa: ARG002 - the interface's
        return CONVERTER

    def read(self, pin: Pin) -> int:
        self._check()
        self._refuse_busy(pin.subdevice)
        return (self.levels if pin.subdevice == LINES else self.codes)[pin.number]

    def write(self, pin: Pin, code: int) -> None:
        self._check()
        self._refuse_busy(pin.subdevice)
        if pin.subdevice == LINES:
            self.levels[pin.number] = code
            return
        self.codes[pin.number] = code
        self.written.append((pin.number, code))

    def lock(self, subdevice: int) -> None:
        self._check()
        if self.locked_by_other:
            raise fault_of(errno.EBUSY, f"lock {subdevice}")

    def unlock(self, subdevice: int) -> None:
        pass

    def buffer_bytes(self, subdevice: int) -> int:  # noqa: ARG002 - the interface's
        return BUFFER_BYTES

    def test(self, pins: list[Pin], timing: Timing) -> Timing:
        least_ns = STEP_NS * len(pins)
        wanted_ns = max(round(timing.interval_ns / STEP_NS) * STEP_NS, least_ns)
        return Timing(wanted_ns, min(timing.n_scans, 2**24))

    def command(self, pins: list[Pin], timing: Timing) -> None:
        self._check()
        self.commands[pins[0].subdevice] = Running(pins, timing)
        (self._sampled if pins[0].subdevice == INPUTS else self._queue).clear()

    def trigger(self, subdevice: int) -> None:
        self._check()
        self.commands[subdevice].start_ns = self.now_ns
        self.wait(0)

    def cancel(self, subdevice: int) -> None:
        self._check()
        self.commands.pop(subdevice, None)

    def waiting_bytes(self, subdevice: int) -> int:  # noqa: ARG002 - the interface's
        return 2 * len(self._queue)

    def put(self, data: memoryview) -> int:
        self._check()
        if self.commands[OUTPUTS].failed:
            raise fault_of(errno.EPIPE, "stream out")
        fits = min(len(data), BUFFER_BYTES - 2 * len(self._queue)) // 2 * 2
        self._queue.extend(memoryview(data[:fits]).cast("H"))
        return fits

    def take(self) -> bytes:
        self._check()
        data = bytes(self._sampled)
        self._sampled.clear()
        return data

    def wait(self, duration_ns: int) -> None:
        """Let time pass, with the points and samples that are due."""
        self.now_ns += duration_ns
        driven = self.commands.get(OUTPUTS)
        if driven is None or driven.start_ns is None:
            return
        due = (self.now_ns - driven.start_ns) // driven.timing.interval_ns + 1
        while driven.runs and driven.n_done < due:
            if len(self._queue) < len(driven.pins):
                driven.failed = True
                return
            for pin in driven.pins:
                self.codes[pin.number] = self._queue.popleft()
            driven.n_done += 1
            self._sample()

    def _sample(self) -> None:
        sampled = self.commands.get(INPUTS)
        if sampled is not None and sampled.runs:
            for pin in sampled.pins:
                self._sampled += self.codes[pin.number].to_bytes(2, "little")
            sampled.n_done += 1

    def _check(self) -> None:
        if self.refuses:
            raise fault_of(self.refuses, "/dev/comedi0")

    def _refuse_busy(self, subdevice: int) -> None:
        if subdevice in self.commands:
            raise LineFault(fault_of(errno.EBUSY, "").flag, "a command is running")
