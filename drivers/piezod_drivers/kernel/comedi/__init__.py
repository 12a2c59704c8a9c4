"""Converter cards of the kernel's comedi drivers, by libcomedi.

`library.py` declares the functions of libcomedi, `card.py` is an open card, `codec.py` converts
codes, and `wired_card.py` knows the channels in use. `player.py` plays tables: `play_stream.py`
carries their codes, `play_arrays.py` has them, and records, as arrays.

Sources: comedilib.h of libcomedi 0.11, the kernel's
comedi_fops.c for what is refused, and comedi_test.c for the card of the checks.
"""
