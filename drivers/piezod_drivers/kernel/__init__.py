"""Devices that a driver of the Linux kernel drives: converter cards in `comedi/`, chips in `iio/`.

`errno_faults.py` turns the errors of the kernel into faults of a line. There is no emulator: the
checks in the virtual machine use the kernel's own drivers.
"""
