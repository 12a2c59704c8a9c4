"""The drivers that ship with piezod, one folder each; they never import each other."""
