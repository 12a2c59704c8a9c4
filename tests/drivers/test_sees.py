"""Every fault that a driver claims to detect is proved by a test."""

from collections import defaultdict
from pathlib import Path

import pytest

from piezod.devices import registry

FOLDER = Path(__file__).parent


def test_every_fault_that_a_driver_sees_is_proved(request: pytest.FixtureRequest) -> None:
    """For each id in a plug-in's `sees` there is a test with a mark for both."""
    marking = {path for path in FOLDER.rglob("test_*.py") if ".sees(" in path.read_text()}
    items = request.session.items
    if request.config.option.keyword or not marking <= {item.path for item in items} | {
        Path(__file__)
    }:
        pytest.skip("only some of the tests were collected")
    proved: defaultdict[str, set[str]] = defaultdict(set)
    for item in items:
        for mark in item.iter_markers("sees"):
            driver, fault = mark.args
            proved[driver].add(fault)
    seen = {name: registry.load(name).sees for name in registry.names()}

    assert {
        name: sorted(ids - proved[name]) for name, ids in seen.items() if ids - proved[name]
    } == {}
    assert set(proved) <= set(seen)
