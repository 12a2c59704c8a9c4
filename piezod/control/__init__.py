"""Control of a stage: one cycle, pure, with time as an argument.

Knows no clocks, processes or buses.
"""
