"""A simulated rig in another process, over a unix socket. It outlives the process of its driver.

`session.py` is the driver's end of the socket, `emulator.py` the rig's.
"""
