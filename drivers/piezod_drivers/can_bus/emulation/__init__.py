"""Emulated nodes on a CAN bus, each in a process of its own.

`node.py` is the interface of a node. `ends.py` connects a node to a bus: to a UDP group, or to a
pty as an slcan adapter. `host.py` serves the node there and injects faults.
"""
