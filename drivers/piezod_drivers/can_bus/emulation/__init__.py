"""The far end of a CAN bus: nodes that exist in a process of their own.

Files: `node.py` is what a node is, `ends.py` what connects it to a bus, a UDP group or an slcan
adapter at a pty; `host.py` serves it there, with faults.
"""
