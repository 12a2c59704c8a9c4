"""What a loop process knows of the outputs when it starts."""

from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from piezod.daemon.loop.process import take_over
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Identity
from piezod.messages import requests as rq
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from tests.control.rig_stage import RigStage

ONE, OTHER = Identity("maker", "model", "7", "1.0"), Identity("maker", "model", "8", "1.0")
HELD = Capabilities((), (), True, 1e3, holds=True)


@pytest.mark.parametrize(
    ("noted_v", "found", "able", "arms"),
    [
        (57.0, ONE, HELD, False),
        (60.0, ONE, HELD, True),
        (nan, ONE, HELD, True),
        (57.0, OTHER, HELD, True),
        (57.0, ONE, HELD._replace(opens_relaxed=True), True),
        (57.0, ONE, HELD._replace(holds=False), True),
        (57.0, ONE, HELD._replace(watchdog=True), True),
    ],
)
def test_stage_is_not_armed_against_what_was_written_last(
    tmp_path: Path, noted_v: float, found: Identity, able: Capabilities, arms: bool
) -> None:
    """The last write of another process counts if the output holds it, and no sensor decides."""
    stage = RigStage()
    stage.channels.write([60.0], 0)
    stage.t_ns += 50_000_000  # the output settles before the first cycle
    devices = SimpleNamespace(identities={"rig": found}, capabilities=lambda: able)
    stage.controller.stay_in_boot(True)
    take_over(
        stage.controller,
        create(tmp_path / "loop.map", Layout.of(stage.config)),
        stage.config,
        cast("Channels", devices),
        {"rig": ONE},
        [noted_v],
    )
    stage.until("SAFE")
    armed = stage.ask(rq.Arm())
    confirmed = stage.ask(rq.Arm(confirm_output=True)) if not arms else armed

    assert armed.accepted is arms, armed.why
    assert confirmed.accepted
