"""Converters of the kernel's IIO drivers: chips on SPI and I²C, as on a Raspberry Pi.

`sysfs.py` finds a device, and reads and writes its files. Tables are not played: the kernel has
output buffers for few converters, and none of them could be run.

Source: Documentation/ABI/testing/sysfs-bus-iio of the kernel.
"""
