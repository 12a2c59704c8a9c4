"""Micro-Epsilon's optical sensors: a stream of measured values at RS422, and commands in text.

Formats after the maker's manuals as public manual sites show them; not confirmed on hardware.
"""
