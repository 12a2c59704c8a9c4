"""Amplifiers of piezosystem jena: d-Drive, 30DV50/300, NV40/3 (CLE), NV40/1 CL, NV200/D.

All that is known of them here comes from public sources: the vendor's `psj-lib` and `nv200`,
micro-manager's adapters and EPICS' motorPiJena. None of it is confirmed on hardware.

Files: `models.py` tells how the models differ, `codec.py` makes and reads what goes over the wire,
`dialogue.py` says it in order, `options.py` is what a configuration may say, `driver.py` leads to
all of it. `emulator.py` is the far end.
"""
