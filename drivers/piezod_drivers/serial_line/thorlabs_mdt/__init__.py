"""Thorlabs MDT693A, MDT693B, MDT694A and MDT694B: open-loop amplifiers with an ASCII protocol.

Facts are from the public sources of pylablib, mdt69x and others who talk to them, not confirmed on
hardware. They differ in how a reply ends: `>` in the B models, `*` in the A models, in the B
models' compatibility mode and in their first firmware; and in words: `XVOLTAGE=12.3` or `XV12.3`.
"""
