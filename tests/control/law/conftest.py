"""The forms of a model, for the facts that hold for each of them."""

import pytest

from tests.control.made_up import RELAXING, STOPS, SURFACE, Kind


@pytest.fixture(
    scope="session", params=[STOPS, SURFACE, RELAXING], ids=["stops", "surface", "relaxing"]
)
def kind(request: pytest.FixtureRequest) -> Kind:
    """Return a made-up hysteresis of each form."""
    kind: Kind = request.param
    return kind
