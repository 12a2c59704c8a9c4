"""The frequency response of an axis: its excitation, its estimate, and what is written."""
