"""Fixtures of the tests with Bluesky, which `make bluesky` runs."""

from importlib.util import find_spec

# Without the environment of `make bluesky` these files cannot even be imported.
if find_spec("ophyd_async") is None:
    collect_ignore_glob = ["test_*.py"]
else:
    from tests.bluesky.fixtures import coarse, documents, engine, fine, x, y

    __all__ = ["coarse", "documents", "engine", "fine", "x", "y"]
