"""The page about drivers: its code is a driver that passes the tests of the page."""

import re
from pathlib import Path
from typing import Any

import pytest

from piezod.devices.interface import Device, Wiring
from piezod.testing.driver_contract import checks_for
from tests.forked import run

PAGE = (Path(__file__).parents[2] / "docs" / "writing-a-driver.md").read_text(encoding="utf-8")


def _blocks(kind: str) -> str:
    return "\n\n".join(re.findall(rf"```{kind}\n(.*?)```", PAGE, flags=re.DOTALL))


def test_page_can_be_copied(tmp_path: Path) -> None:
    """The code of the page, copied into two files, is a driver and its passing tests."""
    (tmp_path / "acme_e1.py").write_text(_blocks("python"), encoding="utf-8")
    (tmp_path / "test_acme_e1.py").write_text(_blocks("python test"), encoding="utf-8")
    arguments = ("-q", "-W", "error", "-p", "no:cacheprovider", "--assert=plain", str(tmp_path))
    done = run(arguments, folder=tmp_path, module="pytest")

    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 passed" in done.stdout


def test_device_without_a_bus_keeps_the_contract(subtests: pytest.Subtests) -> None:
    """The card of the page passes every check of its roles."""
    page: dict[str, Any] = {"__name__": "acme_card"}
    exec(_blocks("python sdk"), page)  # noqa: S102 - the code of this repository
    plugin = page["CARD"]

    def card() -> Device:
        device: Device = plugin.create(plugin.options_model(), Wiring(("x",), ("x_v",)), 1)
        return device

    for check in checks_for(card):
        with subtests.test(check.__name__):
            check(card)
