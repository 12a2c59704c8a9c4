"""What drivers of devices on a wire share: lines, conversations, and the device made of them.

A driver writes a `Dialogue`, which says what goes over the wire; `BusDevice` makes a device of it,
keeps the order of calls and turns every fault of the line into a value.
"""
