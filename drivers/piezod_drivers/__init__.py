"""The drivers that ship with piezod: one folder each. They never import each other.

The table in `drivers/README.md` defines the meaning of each file name.
"""
