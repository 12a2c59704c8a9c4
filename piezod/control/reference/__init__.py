"""Commands over time: waveforms, movements, voltage programs."""
