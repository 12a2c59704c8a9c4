"""CANopen nodes with analogue inputs and outputs: device profile CiA 401.

`objects.py` has the indices, identifiers and codes of CANopen. `setup.py` prepares a node for the
loop; it uses `sdo_client.py`, the canopen library's SDO client without its threads. `sdo_words.py`
reads single channels by SDO in the loop. `health.py` keeps what the node reports by heartbeats and
emergencies.
"""
