"""Converters and amplifiers that speak Modbus, over TCP or RTU (RS-485).

Files: `options.py` is what a configuration may say, `register.py` what a register means,
`profiles/` the devices that need only their name, as data. `requests.py` makes requests and judges
replies; `transactions.py`, with `tcp.py`, `rtu.py` and `checksum.py`, carries them, one at a time.
`plan.py` and `layout.py` say which registers are read together; `setup.py` is what is said before
and after the cycles. `register_dialogue.py` is the driver for register maps, `labjack_dialogue.py`
that for LabJack's combined function; `driver.py` chooses. `emulation/` is the far end of the wire.

After public sources, named beside each profile; nothing here has been confirmed on hardware.
"""
