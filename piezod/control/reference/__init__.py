"""References: waveforms, movements and voltage programs, each a function of time."""
