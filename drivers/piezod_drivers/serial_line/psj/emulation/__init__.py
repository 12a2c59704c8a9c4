"""Parts of the emulated NV200/D: its waveform generator and its data recorder.

`waveforms.py` has both on one clock of 50 µs, `waveform_commands.py` has their commands.
"""
