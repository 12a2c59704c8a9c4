"""Waveforms: a command or a drive voltage over time. `combined` has all kinds of them."""
