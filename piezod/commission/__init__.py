"""Commissioning of real hardware: small steps, each confirmed and undone, and their results.

`procedure.py` has the steps in their order; `noise.py`, `polarity.py`, `travel.py`, `response.py`
and `ringing.py` implement them; only `session.py` drives. `profile.py` turns the results into a
configuration, `sheet.py` into a page. `probe.py` reads the devices and drives nothing.
"""
