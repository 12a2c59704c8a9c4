"""Parts of the emulated CiA 401 node.

`dictionary.py` is its object dictionary, `sdo_server.py` answers requests to read and write it.
"""
