"""What an experiment needs of its stage: virtual, running, or driven by hand.

One way each: `devices` opens devices and leaves them safe, `runs` goes through cases and modes and
judges the errors, `play.stage` is an axis that plays. What stays apart says why: `virtual.stage`,
`live.stage` and `commission.session`.
"""
