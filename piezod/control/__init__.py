"""One control cycle, pure: time is an argument.

Knows nothing of clocks, processes and buses.
"""
