"""Thorlabs MDT693A, MDT693B, MDT694A and MDT694B: open-loop amplifiers with an ASCII protocol.

Facts are from the public sources of pylablib, mdt69x and other clients, and not confirmed on
hardware. The models differ in two ways. A reply ends with `>` in the B models, and with `*` in the
A models, in the B models' compatibility mode and in their first firmware. Commands are long,
`XVOLTAGE=12.3`, or short, `XV12.3`.
"""
