"""The loop process: it owns the devices and runs the cycle in real time."""
