"""Parts of the emulated CiA 401 node.

`object_dictionary.py` has its objects, `sdo_server.py` answers requests to read and write them,
`heartbeat_consumer.py` supervises the host.
"""
