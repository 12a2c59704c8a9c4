"""`python -m piezod`, the same as `piezod`."""

from piezod.cli.main import run

if __name__ == "__main__":
    run()
