"""Micro-Epsilon's optical sensors: a stream of measured values over RS-422, and text commands.

Formats are from the maker's manuals on public manual sites, and not confirmed on hardware.
`identity.py` reads the reply to `GETINFO`.
"""
