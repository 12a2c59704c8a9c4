"""Analogue inputs and outputs that speak CANopen, by the device profile CiA 401.

Files: `options.py` is what a configuration may say, `driver.py` makes the device, `dialogue.py` is
what goes over the bus in the loop. `setup.py` prepares the node for it by `sdo.py`, which is the
canopen library's client without its threads. `objects.py` names what is in a node, `pdo.py` packs
values into process data, `health.py` reads what the node tells of itself. `node.py`, with
`dictionary.py` and `sdo_server.py`, is a node of our own for `piezod emulate`.
"""
