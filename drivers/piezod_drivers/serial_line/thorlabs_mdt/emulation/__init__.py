"""Parts of the emulated amplifiers: `a_model.py` is an MDT693A, `values.py` reads voltages."""
