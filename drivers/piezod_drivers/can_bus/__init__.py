"""Devices on a CAN bus: the common code of the drivers in `cia401/` and `dbc/`.

`frame.py` is a CAN frame. `frame_bus.py` is the interface of a bus that carries frames;
`library_bus.py` implements it by python-can, `slcan_bus.py` by a serial adapter.
`interface_control.py` empties the queue of an interface of the kernel. `conversation.py` sends the
frames of one exchange and waits for their replies.
"""
