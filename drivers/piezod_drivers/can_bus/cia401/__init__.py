"""CANopen nodes with analogue inputs and outputs: device profile CiA 401.

`objects.py` has the indices, identifiers and codes of CANopen. `setup.py` prepares a node for the
loop, `process_data.py` its PDOs; both use `sdo_client.py`, the canopen library's SDO client without
its threads. `sdo_words.py` reads single channels by SDO in the loop. `wired_channels.py` converts
the channels in use. `supervision.py` sends the host's heartbeats, and `health.py` keeps what the
node reports by its own and by emergencies.
"""
