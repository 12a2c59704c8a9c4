"""A fibre sensor on either side of its curve, calibrated by the configuration, in virtual time."""

from pathlib import Path
from typing import Any, Final, Literal

import pytest

from piezod.config.channels import LightConfig, TableCalibration
from piezod.config.daemon import load_daemon
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.status import DeviceFlag
from piezod.devices.wiring import ChannelPair, construct, pairs_of, wiring_of
from piezod.plant.plant import Plant
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

SHIPPED: Final = Path(__file__).parents[2] / "config" / "fibre.yaml"
STEP_NS: Final = 50_000_000
VOLTAGES: Final = (0.0, 40.0, 110.0, 140.0, 70.0, 10.0)


def travelled(channels: Channels) -> list[tuple[float, float]]:
    """Return measured and true displacements, in µm, while the drive rises and falls."""
    channels.open()
    channels.activate(0)
    now_ns, pairs = 0, []
    for drive_v in VOLTAGES:
        assert channels.write([drive_v], now_ns)
        for _ in range(2):
            now_ns += STEP_NS
            samples = channels.read(now_ns)
        assert samples[0].valid
        pairs.append((samples[0].position_um, channels.true_position_um(now_ns)[0]))
    channels.close()
    return pairs


def specimen(**options: Any) -> Plant:
    """Return the physics of the rig with these options."""
    rig = SimulatedRig(SimulatedOptions.model_validate(options), wiring_of("rig", PLAIN), 1)
    rig.open()
    return rig._channels[0].plant  # noqa: SLF001 - what a reference measures, nobody else tells


PLAIN: Final = {"x": ChannelPair("rig", "rig")}


def test_shipped_table_measures_the_shipped_rig() -> None:
    """The error is below 0.3 % of the travel: noise and the amplifier's steps."""
    config = load_daemon(SHIPPED, registry)
    pairs = pairs_of(config.axes)
    channels = Channels(construct(config.devices, pairs, config.seed), pairs)

    for measured_um, true_um in travelled(channels):
        assert measured_um == pytest.approx(true_um, abs=0.1)


@pytest.mark.parametrize("side", ["near", "far"])
def test_either_side_of_the_curve_can_be_used(side: Literal["near", "far"]) -> None:
    """On the far side the light falls with the gap; the displacement is the same."""
    options: dict[str, Any] = {"sensor": {"setback_um": 200.0 if side == "far" else 0.0}}
    plant = specimen(**options)
    gap_um = plant.parameters.sensor.setback_um
    physical = [float(x) for x in range(-round(gap_um) - 10, 41)] + [60.0, 100.0, 150.0, 200.0]
    values = [plant.ideal_reading_v(x) for x in physical]
    table = TableCalibration(values=tuple(values), physical=tuple(physical), side=side)
    light = LightConfig(channel="x_light", nominal=plant.parameters.sensor.light_level, least=0.5)
    axes = {"x": ChannelPair("rig", "rig", "x_v", to_um=table, light=light)}
    rig = SimulatedRig(SimulatedOptions.model_validate(options), wiring_of("rig", axes), 1)

    measured = travelled(Channels({"rig": rig}, axes))

    for measured_um, true_um in measured:
        assert measured_um == pytest.approx(true_um, abs=0.3)
    rises = plant.ideal_reading_v(20.0) > plant.ideal_reading_v(0.0)
    assert rises == (side == "near")


def test_a_fading_lamp_is_corrected_until_it_is_reported() -> None:
    """Below the limit of the light every sample is invalid, and the flag states the reason."""
    config = load_daemon(SHIPPED, registry)
    pairs = pairs_of(config.axes)
    for level, valid in ((0.6, True), (0.4, False)):
        options = SimulatedOptions.model_validate({"sensor": {"light_level": level}})
        rig = SimulatedRig(options, wiring_of("rig", pairs), config.seed)
        channels = Channels({"rig": rig}, pairs)
        channels.open()
        channels.activate(0)
        samples = [channels.read(i * STEP_NS)[0] for i in range(3)]

        assert [sample.valid for sample in samples] == [valid] * 3
        assert (DeviceFlag.LOW_LIGHT in channels.status(3 * STEP_NS)[0]) is not valid
        if valid:
            assert samples[-1].position_um == pytest.approx(0.0, abs=0.3)
        channels.close()
