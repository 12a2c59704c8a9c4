"""The far end of Modbus: devices in a process of their own, with the physics of a bench.

`unit.py` is a device's registers and its answers, `servers.py` the frames around them; the other
files are the devices, `plugins.py` the names under which `piezod emulate` finds them.
"""
