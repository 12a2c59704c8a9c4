"""Devices on a serial port, some of them also over TCP: one folder for each protocol.

`options.py` has the options of the line, which all of them share. `quiet.py` reads until the line
is quiet. `wave_arrays.py` has the tables and records of the devices that play.
"""
