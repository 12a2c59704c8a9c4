"""Controllers without a process."""

from collections.abc import Iterator

import pytest

from tests.gcs.fake_stage import Controller, Dialogue


@pytest.fixture
def controller() -> Iterator[Controller]:
    """Return a controller of a stage with the axes x and y, disarmed."""
    controller = Controller("x", "y")
    with controller.runner:
        yield controller


@pytest.fixture
def client(controller: Controller) -> Dialogue:
    """Return the only connection to the controller."""
    return controller.client()


@pytest.fixture
def armed(client: Dialogue) -> Dialogue:
    """Return a connection that has switched both servos on."""
    assert client.error_of("SVO 1 1 2 1") == 0
    return client
