"""Devices on a CAN bus.

Files: `frame.py` and `frame_bus.py` are what all have in common, frames and a bus that carries
them. Two implement it: `library_bus.py` by python-can, `slcan_bus.py` (with `slcan.py`, the codec)
by a serial adapter. `options.py` is what a configuration may say about the bus. `cycle.py` is one
exchange in the loop. `cia401/` speaks CANopen to analogue I/O, `dbc/` to whatever a DBC file
describes.
"""
