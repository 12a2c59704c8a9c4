"""What both generations of PI's General Command Set have in common.

Facts are from the public sources of PIPython, micro-manager and EPICS' motorPI, not confirmed on
hardware: a set command has no reply, `ERR?` tells afterwards whether it was carried out, and a
query that is not understood has no reply either. Every request here therefore ends with `ERR?`: it
has always a reply, and an error is known in the exchange that made it.
"""
