"""First contact with real hardware: small steps, each confirmed and undone, and what they tell.

From the top: `procedure.py` is the order of the steps; `noise.py`, `polarity.py`, `travel.py`,
`response.py` and `ringing.py` are what they do; `session.py` is the only one that drives. What was
found becomes a configuration in `profile.py` and a page in `sheet.py`. `probe.py` looks and touches
nothing.
"""
