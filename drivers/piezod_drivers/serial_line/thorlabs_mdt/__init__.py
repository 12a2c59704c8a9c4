"""Thorlabs MDT693A, MDT693B, MDT694A and MDT694B: open-loop amplifiers with an ASCII protocol.

Facts are from the maker's manuals, from captures of an MDT693A, an MDT693B and two MDT694B in
jekktmoeder/Thorlabs_MDT, and from the public sources of pylablib, mdt69x, libics and other
clients. The models differ. A reply ends with `>` in the B models, and with `*` in the B models'
compatibility mode and in some of their firmware; in the A models it begins with `*`. Commands are
long, `XVOLTAGE=12.3`, or short, `XV12.3`. The A models echo in lower case, their echo is toggled
by `E`, and a NUL follows some of their prompts, which `nul_free_line.py` removes.
"""
