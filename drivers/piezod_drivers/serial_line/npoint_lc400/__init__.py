"""nPoint's LC.400 controllers: registers that are read and written in binary frames.

Frames and addresses after the public source of the EPICS module motorNPoint and of other drivers;
not confirmed on hardware.
"""
