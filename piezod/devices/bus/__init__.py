"""Common parts of drivers for devices on a wire: lines, conversations, and the device itself.

A driver implements a `Dialogue`, the exchanges of its protocol. `BusDevice` makes a device of it,
enforces the order of calls and turns every fault of the line into a value.
"""
