"""What a loop process knows of the outputs when it starts."""

from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import cast
from unittest.mock import MagicMock

import pytest

from piezod.daemon.loop.process import take_over
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Identity
from piezod.messages import requests as rq
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from tests.control.rig_stage import RigStage, shipped_config

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
    rig = SimpleNamespace(capabilities=lambda: able)
    devices = SimpleNamespace(identities={"rig": found}, devices={"rig": rig})
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


@pytest.mark.parametrize(
    ("x_able", "kept"),
    [
        (HELD, [75.0, 10.0]),
        (HELD._replace(watchdog=True), [nan, 10.0]),
        (HELD._replace(holds=False), [nan, 10.0]),
        (HELD._replace(opens_relaxed=True), [nan, 10.0]),
    ],
)
def test_each_amplifier_answers_for_its_own_axes(
    tmp_path: Path, x_able: Capabilities, kept: list[float]
) -> None:
    """One that goes to rest when it is closed does not make another one forget, nor remember."""
    config = shipped_config()
    x = config.axes["x"]
    second = x.amplifier.model_copy(update={"device": "two"})
    y = x.model_copy(update={"amplifier": second})
    config = config.model_copy(update={"axes": {"x": x, "y": y}})
    able = {x.amplifier.device: x_able, "two": HELD}
    devices = {
        name: SimpleNamespace(capabilities=lambda has=has: has) for name, has in able.items()
    }
    channels = SimpleNamespace(identities=dict.fromkeys(able, ONE), devices=devices)
    controller = MagicMock()
    take_over(
        controller,
        create(tmp_path / "loop.map", Layout.of(config)),
        config,
        cast("Channels", channels),
        dict.fromkeys(able, ONE),
        [75.0, 10.0],
    )

    (known,) = controller.know_last_writes.call_args.args
    assert known == pytest.approx(kept, nan_ok=True)
