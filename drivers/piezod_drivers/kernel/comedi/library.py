"""The functions and structures of libcomedi that the driver uses, as ctypes knows them."""

import ctypes
from ctypes import POINTER, Structure, c_char_p, c_double, c_int, c_uint, c_void_p
from functools import cache
from typing import Any, Final

NAME: Final = "libcomedi.so.0"
OWN_ERRORS: Final = 0x1000
"""Error numbers from here on are libcomedi's own."""

INPUTS, OUTPUTS = 1, 2
"""Types of the subdevices with analogue inputs and outputs."""
DIGITAL_INPUTS, DIGITAL_OUTPUTS, DIGITAL_BOTH = 3, 4, 5
"""Types of the subdevices with digital lines; each of the last one can be either."""
VOLT: Final = 0
SOFT_CALIBRATED: Final = 0x2000
COMMAND_WRITE: Final = 0x4000
COMMAND_READ: Final = 0x8000
RUNNING: Final = 0x0800_0000
LONG_SAMPLES: Final = 0x1000_0000
"""Flags of a subdevice."""
COUNT: Final = 0x20
INTERNAL: Final = 0x80
TIMER: Final = 0x10
"""Sources of the events of a command."""
FLAG_WRITE: Final = 0x40
TO_PHYSICAL, FROM_PHYSICAL = 0, 1


class PolynomialStruct(Structure):
    """Conversion of a channel."""

    _fields_ = (("coefficients", c_double * 4), ("origin", c_double), ("order", c_uint))


class Command(Structure):
    """Command that samples or drives by the card's clock."""

    _fields_ = (
        *((name, c_uint) for name in ("subdev", "flags")),
        *((name, c_uint) for name in ("start_src", "start_arg")),
        *((name, c_uint) for name in ("scan_begin_src", "scan_begin_arg")),
        *((name, c_uint) for name in ("convert_src", "convert_arg")),
        *((name, c_uint) for name in ("scan_end_src", "scan_end_arg")),
        *((name, c_uint) for name in ("stop_src", "stop_arg")),
        ("chanlist", POINTER(c_uint)),
        ("chanlist_len", c_uint),
        ("data", c_void_p),
        ("data_len", c_uint),
    )


_NUMBERS: Final = (c_void_p, c_uint)
_FUNCTIONS: Final[dict[str, tuple[Any, tuple[Any, ...]]]] = {
    "comedi_open": (c_void_p, (c_char_p,)),
    "comedi_close": (c_int, (c_void_p,)),
    "comedi_loglevel": (c_int, (c_int,)),
    "comedi_errno": (c_int, ()),
    "comedi_fileno": (c_int, (c_void_p,)),
    "comedi_get_driver_name": (c_char_p, (c_void_p,)),
    "comedi_get_board_name": (c_char_p, (c_void_p,)),
    "comedi_get_version_code": (c_int, (c_void_p,)),
    "comedi_find_subdevice_by_type": (c_int, (c_void_p, c_int, c_uint)),
    "comedi_get_n_subdevices": (c_int, (c_void_p,)),
    "comedi_get_subdevice_type": (c_int, _NUMBERS),
    "comedi_get_subdevice_flags": (c_int, _NUMBERS),
    "comedi_get_n_channels": (c_int, _NUMBERS),
    "comedi_get_maxdata": (c_uint, (*_NUMBERS, c_uint)),
    "comedi_find_range": (c_int, (*_NUMBERS, c_uint, c_uint, c_double, c_double)),
    "comedi_data_read": (c_int, (*_NUMBERS, c_uint, c_uint, c_uint, POINTER(c_uint))),
    "comedi_data_write": (c_int, (*_NUMBERS, c_uint, c_uint, c_uint, c_uint)),
    "comedi_dio_config": (c_int, (*_NUMBERS, c_uint, c_uint)),
    "comedi_dio_get_config": (c_int, (*_NUMBERS, c_uint, POINTER(c_uint))),
    "comedi_lock": (c_int, _NUMBERS),
    "comedi_unlock": (c_int, _NUMBERS),
    "comedi_cancel": (c_int, _NUMBERS),
    "comedi_poll": (c_int, _NUMBERS),
    "comedi_get_max_buffer_size": (c_int, _NUMBERS),
    "comedi_set_buffer_size": (c_int, (*_NUMBERS, c_uint)),
    "comedi_get_buffer_contents": (c_int, _NUMBERS),
    "comedi_set_read_subdevice": (c_int, _NUMBERS),
    "comedi_set_write_subdevice": (c_int, _NUMBERS),
    "comedi_get_cmd_src_mask": (c_int, (*_NUMBERS, POINTER(Command))),
    "comedi_get_cmd_generic_timed": (c_int, (*_NUMBERS, POINTER(Command), c_uint, c_uint)),
    "comedi_command_test": (c_int, (c_void_p, POINTER(Command))),
    "comedi_command": (c_int, (c_void_p, POINTER(Command))),
    "comedi_internal_trigger": (c_int, (c_void_p, c_uint, c_uint)),
    "comedi_get_default_calibration_path": (c_void_p, (c_void_p,)),
    "comedi_parse_calibration_file": (c_void_p, (c_char_p,)),
    "comedi_cleanup_calibration": (None, (c_void_p,)),
    "comedi_get_hardcal_converter": (
        c_int,
        (c_void_p, c_uint, c_uint, c_uint, c_int, POINTER(PolynomialStruct)),
    ),
    "comedi_get_softcal_converter": (
        c_int,
        (c_uint, c_uint, c_uint, c_int, c_void_p, POINTER(PolynomialStruct)),
    ),
}


@cache
def libcomedi() -> Any:
    """Load libcomedi.

    Raises:
        OSError: If it is not installed.
    """
    library = ctypes.CDLL(NAME)
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    library.comedi_loglevel(0)
    return library
