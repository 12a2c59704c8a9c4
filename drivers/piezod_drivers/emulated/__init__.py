"""A rig in another process, over a unix socket: it lives on when its driver's process dies.

Files: `options.py` is what a configuration may say, `driver.py` is the device, `link.py` its end of
the socket. `wire.py` is what goes over it. `server.py`, `trace.py` and `host.py` are the rig's end.
"""
