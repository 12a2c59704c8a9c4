"""A running stage as devices of Bluesky: over the public client, in the process of the RunEngine.

It needs the extra `bluesky`.
"""

from piezod.bluesky.axis import PiezoAxis
from piezod.bluesky.plans import hold_after_failure
from piezod.bluesky.play import Play
from piezod.bluesky.scan import Scan
from piezod.bluesky.stage import PiezoStage
from piezod.bluesky.wave import Wave

__all__ = ["PiezoAxis", "PiezoStage", "Play", "Scan", "Wave", "hold_after_failure"]
