"""An open converter card, over libcomedi."""

import ctypes
import errno
import os
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

from piezod.devices.bus.line import LineFault
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.kernel.comedi import library as names
from piezod_drivers.kernel.comedi.card import Pin, Timing
from piezod_drivers.kernel.comedi.codec import Converter, Polynomial
from piezod_drivers.kernel.errno_faults import fault_of, refusal

_ABSENT: Final = "plug the card in, or load the kernel's driver for it: sudo modprobe"
_GROUP: Final = "the user has to be in the group of this file, iocard in Debian"
_TESTS: Final = 6
"""Number of tests after which a command that the driver still changes counts as impossible."""


class ComediCard:
    """Implements `Card` over libcomedi.

    Args:
        path: File of the card.
    """

    def __init__(self, path: str) -> None:
        with suppress(OSError):  # now, because a card is opened again long after the start
            names.libcomedi()
        self._path = path
        self._library: Any = None
        self._device: int | None = None
        self._fd = -1
        self._code = ctypes.c_uint()
        self._commands: dict[int, names.Command] = {}

    def open(self) -> tuple[str, str, str]:
        """Open the card; return driver, board, and version of the kernel's comedi."""
        try:
            library = self._library = names.libcomedi()
        except OSError as error:
            what = f"libcomedi is missing ({error}): sudo apt install libcomedi0"
            raise DeviceUnavailableError(what) from error
        self._device = library.comedi_open(os.fsencode(self._path))
        if self._device is None:
            raise refusal(self._path, self._number(), _ABSENT, _GROUP)
        device = self._device
        self._fd = library.comedi_fileno(device)
        os.set_blocking(self._fd, False)
        version = library.comedi_get_version_code(device)
        driver, board = (
            library.comedi_get_driver_name(device),
            library.comedi_get_board_name(device),
        )
        parts = (version >> 16, version >> 8 & 0xFF, version & 0xFF)
        return os.fsdecode(driver), os.fsdecode(board), ".".join(map(str, parts))

    def close(self) -> None:
        """Close it."""
        device, self._device = self._device, None
        self._commands.clear()
        if device is not None:
            self._library.comedi_close(device)

    def subdevice(self, kind: int) -> int:
        """Return the first subdevice of a kind."""
        return int(self._library.comedi_find_subdevice_by_type(self._device, kind, 0))

    def flags(self, subdevice: int) -> int:
        """Return the flags of a subdevice."""
        return self._done(
            self._library.comedi_get_subdevice_flags(self._device, subdevice), "status"
        )

    def pin(self, subdevice: int, number: int, volts: tuple[float, float], reference: int) -> Pin:
        """Return a channel with the smallest range that holds these voltages."""
        library, device = self._library, self._device
        n_channels = library.comedi_get_n_channels(device, subdevice)
        if not number < n_channels:
            raise DeviceError(
                f"{self._path} has no channel {number} there, allowed: 0 to {n_channels - 1}"
            )
        at = library.comedi_find_range(device, subdevice, number, names.VOLT, *volts)
        if at < 0:
            raise DeviceError(
                f"channel {number} of {self._path} has no range that holds {volts[0]:g} to "
                f"{volts[1]:g} V: give a smaller `range`; comedi_board_info -v lists them"
            )
        return Pin(subdevice, number, at, reference)

    def line(self, number: int, subdevice: int | None, *, driven: bool) -> Pin:
        """Return a digital line."""
        library, device = self._library, self._device
        kinds = (names.DIGITAL_OUTPUTS if driven else names.DIGITAL_INPUTS, names.DIGITAL_BOTH)
        here = range(library.comedi_get_n_subdevices(device)) if subdevice is None else (subdevice,)
        able = [each for each in here if self._kind(each) in kinds]
        for each in able:
            if number < library.comedi_get_n_channels(device, each):
                return Pin(each, number, 0, 0)
        what = f"digital {'output' if driven else 'input'} {number}"
        where = "" if subdevice is None else f" on subdevice {subdevice}"
        most = max((library.comedi_get_n_channels(device, each) for each in able), default=0)
        raise DeviceError(
            f"{self._path} has no {what}{where}, allowed: {f'0 to {most - 1}' if most else 'none'};"
            " comedi_board_info -v lists the subdevices"
        )

    def direct(self, outputs: Sequence[Pin], inputs: Sequence[Pin]) -> None:
        """Make digital lines outputs and inputs."""
        # Inputs last: in a group that has one direction no line drives against its source then.
        for pins, driven in ((outputs, True), (inputs, False)):
            for pin in pins:
                if self._is_output(pin) != driven:
                    done = self._library.comedi_dio_config(self._device, *pin[:2], driven)
                    self._done(done, "direction of a line")
        for pin in outputs:
            if not self._is_output(pin):
                raise DeviceError(
                    f"line {pin.number} of subdevice {pin.subdevice} of {self._path} cannot be an "
                    "output beside these inputs: lines of a group have one direction; use a line "
                    "of another group"
                )

    def converter(self, pin: Pin, calibration: str | None) -> Converter:
        """Return the conversion of a channel."""
        most = self._library.comedi_get_maxdata(self._device, *pin[:2])
        if not self.flags(pin.subdevice) & names.SOFT_CALIBRATED:
            polynomials = [self._hard(pin, way) for way in (names.TO_PHYSICAL, names.FROM_PHYSICAL)]
            return Converter(polynomials[0], polynomials[1], most)
        path, library = calibration or self._default_calibration(), self._library
        parsed = library.comedi_parse_calibration_file(os.fsencode(path))
        if parsed is None:
            raise DeviceError(
                f"{self._path} is calibrated by software, and {path} cannot be read: run "
                f"`comedi_soft_calibrate -f {self._path}`, or name the file as `calibration`"
            )
        try:
            to_v, from_v = (
                self._soft(pin, way, parsed) for way in (names.TO_PHYSICAL, names.FROM_PHYSICAL)
            )
        finally:
            library.comedi_cleanup_calibration(parsed)
        return Converter(to_v, from_v, most)

    def read(self, pin: Pin) -> int:
        """Return the code of a channel."""
        code = self._code
        self._done(self._library.comedi_data_read(self._device, *pin, code), "read")
        return code.value

    def write(self, pin: Pin, code: int) -> None:
        """Set the code of an output."""
        self._done(self._library.comedi_data_write(self._device, *pin, code), "write")

    def lock(self, subdevice: int) -> None:
        """Keep other programs from using a subdevice."""
        self._done(self._library.comedi_lock(self._device, subdevice), "lock")

    def unlock(self, subdevice: int) -> None:
        """Let other programs use a subdevice."""
        self._library.comedi_unlock(self._device, subdevice)

    def buffer_bytes(self, subdevice: int) -> int:
        """Make the buffer of a subdevice as large as it may be."""
        library, device = self._library, self._device
        most = self._done(library.comedi_get_max_buffer_size(device, subdevice), "buffer")
        return self._done(library.comedi_set_buffer_size(device, subdevice, most), "buffer")

    def test(self, pins: list[Pin], timing: Timing) -> Timing:
        """Return the timing that the card would have if it were asked for this one."""
        command = self._tested(pins, timing)
        if command.scan_begin_src == names.TIMER:
            return Timing(command.scan_begin_arg, command.stop_arg)
        return Timing(command.convert_arg * len(pins), command.stop_arg)

    def command(self, pins: list[Pin], timing: Timing) -> None:
        """Prepare to sample, or to drive, at this timing."""
        command, subdevice = self._tested(pins, timing), pins[0].subdevice
        library, device = self._library, self._device
        if command.flags & names.FLAG_WRITE:
            self._done(library.comedi_set_write_subdevice(device, subdevice), "command")
        else:
            self._done(library.comedi_set_read_subdevice(device, subdevice), "command")
        self._commands[subdevice] = command
        if command.start_src == names.INTERNAL:
            self._done(library.comedi_command(device, command), "command")

    def trigger(self, subdevice: int) -> None:
        """Start the prepared command of a subdevice."""
        command = self._commands[subdevice]
        if command.start_src == names.INTERNAL:
            self._done(self._library.comedi_internal_trigger(self._device, subdevice, 0), "trigger")
        else:  # such a command starts at once
            self._done(self._library.comedi_command(self._device, command), "command")

    def cancel(self, subdevice: int) -> None:
        """End the command of a subdevice, if there is one."""
        self._done(self._library.comedi_cancel(self._device, subdevice), "cancel")

    def waiting_bytes(self, subdevice: int) -> int:
        """Return how many bytes of the buffer the card has not taken yet."""
        library, device = self._library, self._device
        library.comedi_poll(device, subdevice)  # some cards count only when asked
        return self._done(library.comedi_get_buffer_contents(device, subdevice), "buffer")

    def put(self, data: memoryview) -> int:
        """Append bytes to the buffer of the outputs; return how many fit."""
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._fault(error.errno or errno.EIO, "stream out") from error

    def take(self) -> bytes:
        """Return the bytes that were sampled since the last call."""
        try:
            return os.read(self._fd, 1 << 20)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._fault(error.errno or errno.EIO, "stream in") from error

    def _kind(self, subdevice: int) -> int:
        return int(self._library.comedi_get_subdevice_type(self._device, subdevice))

    def _is_output(self, line: Pin) -> bool:
        kind, direction = self._kind(line.subdevice), ctypes.c_uint()
        if kind == names.DIGITAL_BOTH:
            done = self._library.comedi_dio_get_config(self._device, *line[:2], direction)
            self._done(done, "direction of a line")
            return bool(direction.value)
        return kind == names.DIGITAL_OUTPUTS

    def _tested(self, pins: list[Pin], timing: Timing) -> names.Command:
        """Return a command that the card accepts, with the timing nearest to the given one."""
        library, device, subdevice = self._library, self._device, pins[0].subdevice
        command, can = names.Command(), names.Command()
        self._done(library.comedi_get_cmd_src_mask(device, subdevice, can), "command")
        interval_ns, n_scans = timing
        made = library.comedi_get_cmd_generic_timed(
            device, subdevice, command, len(pins), interval_ns
        )
        self._done(made, "command by a timer")
        if can.start_src & names.INTERNAL:
            command.start_src, command.start_arg = names.INTERNAL, 0
        command.chanlist = (ctypes.c_uint * len(pins))(*(pin.packed for pin in pins))
        command.chanlist_len = command.scan_end_arg = len(pins)
        command.stop_src, command.stop_arg = names.COUNT, n_scans
        if self.flags(subdevice) & names.COMMAND_WRITE:
            command.flags |= names.FLAG_WRITE
        for _ in range(_TESTS):
            if not self._done(library.comedi_command_test(device, command), "command"):
                return command
        raise self._fault(errno.EINVAL, "command")

    def _hard(self, pin: Pin, way: int) -> Polynomial:
        found = names.PolynomialStruct()
        self._done(
            self._library.comedi_get_hardcal_converter(self._device, *pin[:3], way, found), "range"
        )
        return _polynomial(found)

    def _soft(self, pin: Pin, way: int, parsed: int) -> Polynomial:
        found = names.PolynomialStruct()
        if self._library.comedi_get_softcal_converter(*pin[:3], way, parsed, found) < 0:
            raise DeviceError(
                f"the calibration file has no channel {pin.number} of subdevice {pin.subdevice}: "
                "run comedi_soft_calibrate anew"
            )
        return _polynomial(found)

    def _default_calibration(self) -> str:
        address = self._library.comedi_get_default_calibration_path(self._device)
        return os.fsdecode(ctypes.string_at(address)) if address else "its calibration file"

    def _done(self, result: int, what: str) -> int:
        """Return a result of libcomedi; raise the fault if it is an error. Real-time safe."""
        if result < 0:
            raise self._fault(self._number(), what)
        return result

    def _number(self) -> int:
        number = int(self._library.comedi_errno())
        return errno.EINVAL if number >= names.OWN_ERRORS else number

    def _fault(self, number: int, what: str) -> LineFault:
        return fault_of(number, f"{self._path}: {what}")


def _polynomial(found: names.PolynomialStruct) -> Polynomial:
    return Polynomial(tuple(found.coefficients[: found.order + 1]), found.origin)
