"""The player board: a microcontroller with converters, and the firmware of `firmware/player`.

`player.py` plays tables, `wave_requests.py` has the exchanges of a play, `line_pulses.py` its
pulses, `identity.py` reads what a board is. The protocol is described in `docs/board-protocol.md`.
The emulated board is the compiled firmware in simavr. No hardware has confirmed it.
"""
