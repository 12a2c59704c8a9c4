"""The HTTP service of a daemon: who may ask for what, and how it is answered."""
