"""Parts of the hosted rig: `server.py` is its end of the socket."""
