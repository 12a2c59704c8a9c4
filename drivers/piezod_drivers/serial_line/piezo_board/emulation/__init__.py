"""Parts of the emulated board: `build.py` compiles it, `simavr.py` runs it."""
