"""Options of an amplifier of piezosystem jena."""

import pytest
from pydantic import ValidationError

from piezod_drivers.serial_line.psj.driver import PLUGIN
from piezod_drivers.serial_line.psj.options import PsjOptions
from piezod_drivers.serial_line.psj.profiles import ProfileName, ReadingUse


@pytest.mark.parametrize(
    ("profile", "baud"),
    [
        ("ddrive", 115_200),
        ("30dv", 115_200),
        ("nv40", 19_200),
        ("nv40-1", 9600),
        ("nv200", 115_200),
    ],
)
def test_the_baud_rate_is_the_models_unless_it_is_given(profile: ProfileName, baud: int) -> None:
    """Without a configured bit rate the model's is used."""
    assert PsjOptions(profile=profile, port="p").configured_profile().baud == baud
    assert PsjOptions(profile=profile, port="p", baud=57_600).configured_profile().baud == 57_600


@pytest.mark.parametrize(
    ("profile", "reads", "inputs"),
    [
        ("ddrive", None, 0),
        ("ddrive", "position", 6),
        ("30dv", "position", 1),
        ("nv40", None, 3),
        ("nv40", "voltage", 0),
        ("nv40-1", None, 0),
        ("nv200", None, 1),
        ("nv200", "nothing", 0),
    ],
)
def test_only_positions_are_inputs(
    profile: ProfileName, reads: ReadingUse | None, inputs: int
) -> None:
    """A reading is an input if it is a position; a d-Drive's only if configured."""
    units = PLUGIN.channels(PsjOptions(profile=profile, port="p", reads=reads))

    assert units is not None
    assert list(units.inputs.values()) == ["µm"] * inputs
    assert set(units.outputs.values()) == {"V"}


def test_a_range_has_a_width() -> None:
    """A lowest voltage that is not below the highest is an error."""
    with pytest.raises(ValidationError, match="must be above the first of the two"):
        PsjOptions(profile="nv200", port="p", range_v=(5.0, 5.0))


def test_only_an_nv40_has_to_be_said_to_be_under_remote_control() -> None:
    """`remote` is refused for models whose state can be read."""
    assert PsjOptions(profile="nv40-1", port="p", remote=True).remote
    with pytest.raises(ValidationError, match="not for nv200, whose state is read"):
        PsjOptions(profile="nv200", port="p", remote=True)
