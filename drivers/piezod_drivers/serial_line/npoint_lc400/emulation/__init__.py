"""Parts of the emulated controller: `wavetables.py` has its wavetables and its recorder."""
