"""Converter cards of the kernel's comedi drivers, by libcomedi.

`library.py` declares the functions of libcomedi, `card.py` says what an open card does, and
`comedi_card.py` is one. `codec.py` converts codes, and `wired_card.py` knows the channels in use.
`player.py` plays tables: `play_stream.py` carries their codes, `play_arrays.py` has them, and
records, as arrays.

Sources: comedilib.h of libcomedi 0.11, the kernel's comedi_fops.c for what is refused, drivers.c
for reading and setting one line, comedi_test.c and comedi_parport.c for the cards of the checks.
"""
