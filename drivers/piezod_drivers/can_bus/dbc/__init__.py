"""Devices whose frames are described by a DBC file, or by the configuration itself.

`database.py` reads a DBC file by the cantools library. `used_signals.py` selects the messages and
signals that a wiring uses. `messages.py` makes and checks frames with their counters; their
checksums are in `checksum.py`.
"""
