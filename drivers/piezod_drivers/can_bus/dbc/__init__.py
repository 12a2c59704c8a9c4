"""Devices whose frames a DBC file describes, or the configuration itself.

Files: `options.py` is what a configuration may say, `driver.py` makes the device, `dialogue.py` is
what goes over the bus. `layout.py` packs and unpacks signals, `checksum.py` their checksums,
`database.py` reads a DBC file by cantools. `demo.py` is a device of our own for `piezod emulate`,
described by config/devices/can-dbc-demo.dbc.
"""
