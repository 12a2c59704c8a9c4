"""The running stage as a PI GCS 2 controller: a process of its own, between programs and a daemon.

Facts of the protocol are from the public sources of the clients: micro-manager's PI_GCS_2, EPICS'
motorPIGCS2, pylablib. A set command has no reply, and `ERR?` reports and clears the last error. A
refused query has no reply either.
"""
