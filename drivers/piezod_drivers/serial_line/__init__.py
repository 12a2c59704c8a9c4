"""Devices on a serial port, some of them over TCP too; a folder for each protocol.

`options.py` is what the configurations of all of them say about the line.
"""
