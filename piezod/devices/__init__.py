"""The device interface, and the lookup of drivers by name.

The package does not know which drivers exist. They are modules of other distributions, found by
entry point.
"""
