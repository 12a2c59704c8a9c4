"""nPoint's LC.400 controllers: registers that are read and written in binary frames.

Frames and addresses are from the public source of the EPICS module motorNPoint and of other
drivers, and not confirmed on hardware.
"""
