"""Amplifiers of piezosystem jena: d-Drive, 30DV50/300, NV40/3 (CLE), NV40/1 CL, NV200/D.

Facts are from public sources: the vendor's `psj-lib` and `nv200`, micro-manager's adapters and
EPICS' motorPiJena. None of them is confirmed on hardware.

`player.py` plays tables on an NV200/D, `wave_requests.py` has the exchanges of a play; their source
is `nv200`. `session.py` asks in the terms of the protocol. `setup.py` identifies the device,
`takeover.py` checks whether control can be taken without a jump. `reading_age.py` dates readings of
a device that refreshes them seldom.
"""
