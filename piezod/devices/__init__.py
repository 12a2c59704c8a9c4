"""What a device is, and how a driver for one is found.

Knows nothing of which drivers exist: they are other distributions' modules, found by entry point.
"""
