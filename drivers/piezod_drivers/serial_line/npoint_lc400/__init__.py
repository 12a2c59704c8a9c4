"""nPoint's LC.400 controllers: registers that are read and written in binary frames.

`player.py` plays tables with the wavetables and the recorder, `wave_requests.py` has the exchanges
of a play. Frames and addresses are from the public source of the EPICS module motorNPoint and of
other drivers; those of wavetables and recorder are from matlab-npoint-lc400, and from a MATLAB
class PiezoNpoint that quotes the manual. None is confirmed on hardware.
"""
