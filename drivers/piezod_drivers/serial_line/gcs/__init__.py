"""PI's General Command Set: the common code of the drivers of both generations.

Facts are from the public sources of PIPython, micro-manager and EPICS' motorPI, and not confirmed
on hardware. A set command has no reply; `ERR?` reports afterwards whether it was carried out. A
query that the controller does not understand has no reply either. Therefore every request here ends
with `ERR?`: it always has a reply, and an error is known in the exchange that caused it.

`syntax.py` is the interface that the codec of each generation implements. `reply.py` finds and
reads replies, `errors.py` has the error codes, `identity.py` reads the reply to `*IDN?`. The
plug-ins share `channels.py`, `faults.py` and `rate.py`.
"""
