"""The folders of a user."""

from pathlib import Path
from typing import NoReturn

import pytest

from piezod.client.places import groups_file
from piezod.daemon.paths import stage_paths
from piezod.home import user_folder


@pytest.fixture
def no_home(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let this user have no home, as one without an entry and without HOME."""

    def unknown() -> NoReturn:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", unknown)


def test_variable_is_taken_before_the_home() -> None:
    """An absolute path in the variable counts, a relative one does not."""
    assert user_folder("XDG_STATE_HOME", {"XDG_STATE_HOME": "/state"}) == Path("/state")
    assert user_folder("XDG_CACHE_HOME", {"XDG_CACHE_HOME": "cache"}) == Path.home() / ".cache"


@pytest.mark.usefixtures("no_home")
def test_missing_home_names_what_to_set() -> None:
    """A user without a home is told the variable, and needs none where it is set."""
    with pytest.raises(FileNotFoundError, match="XDG_STATE_HOME"):
        stage_paths(Path("lab.yaml"), {})
    assert stage_paths(Path("lab.yaml"), {"XDG_STATE_HOME": "/s"}).state == Path("/s/piezod/lab")


@pytest.mark.usefixtures("no_home")
def test_client_without_a_home_uses_the_groups_of_the_machine() -> None:
    """Clients need no home."""
    system = Path("/etc/piezod/groups.yaml")

    assert groups_file({}, system) == system
