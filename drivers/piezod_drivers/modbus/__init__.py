"""Converters and amplifiers that speak Modbus, over TCP or RTU (RS-485).

`register.py` describes one register. `blocks.py` groups registers into requests, `layout.py` makes
all blocks of a configuration. `transactions.py` is the interface that carries one request and its
reply; `tcp_transactions.py` and `rtu_transactions.py` implement it, with `checksum.py` for RTU.
`setup.py` has the exchanges before and after the loop. `register_dialogue.py` drives register maps,
`labjack_dialogue.py` a LabJack by its combined function; `driver.py` chooses one of them.

`player.py` plays tables on a LabJack. `stream_setup.py` and `stream_requests.py` have its requests
before and during a play, `stream_record.py` collects what comes, `stream_arrays.py` makes arrays.

The sources are public and named beside each profile. Nothing here is confirmed on hardware.
"""
