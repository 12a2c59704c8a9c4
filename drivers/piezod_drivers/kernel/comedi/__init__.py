"""Converter cards of the kernel's comedi drivers, by libcomedi.

`library.py` declares the functions of libcomedi, `card.py` is an open card, `codec.py` converts
codes, and `wired_card.py` knows the channels in use. `play_stream.py` carries the codes of a play,
and `play_arrays.py` has its tables and records as arrays.

Sources: comedilib.h of libcomedi 0.11, and Documentation of its functions; the kernel's
comedi_fops.c for what is refused, and comedi_test.c for the card of the checks.
"""
