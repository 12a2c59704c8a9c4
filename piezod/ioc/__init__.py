"""The running stages as EPICS records: a process of its own, between EPICS clients and daemons.

`table` declares the records, `stage` fills them and carries out what clients write, over the public
client. Only `softioc_records`, `motor_record` and `record_type` use softioc, which comes with the
extra `epics`.
"""
