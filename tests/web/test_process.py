"""The server of the page as a process, with a daemon that is killed."""

import signal
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

from tests.daemon.daemons import Daemon, configuration
from tests.daemon.waiting import eventually
from tests.forked import forked
from tests.web.browser import Browser, Tab


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    """Return the daemon of a simulated stage, "rig"."""
    with Daemon(configuration(tmp_path)) as daemon:
        yield daemon.up()


def state_of(tab: Tab) -> str:
    """Return the state of the stage in the list of the page; empty if it is down."""
    (stage,) = tab.ask(do="stages")["result"]["stages"]
    return str(stage["status"]["state"]) if stage["status"] else ""


def test_daemon_killed_while_a_tab_holds_the_lease(
    daemon: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page reports the gap and the state after the restart; its lease ends with the tab."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(daemon.folder))
    with forked("web", "--port", "0") as process:
        url = urlsplit(process.stdout.readline().strip())
        browser = Browser(url.port or 0, parse_qs(url.query)["token"][0])
        with browser.tab() as tab:
            assert tab.ask(do="watch", stage="rig")["ok"]
            assert tab.event("telemetry")["axes"].keys() == {"x"}
            assert tab.call("/v1/arm", stage="rig")["result"]["state"] == "READY"
            assert "error" in daemon.ask("POST", "goto", {"position_um": 3.0}).json()

            daemon.process.kill()
            daemon.process.wait()
            down = tab.event("stage", up=False)
            assert state_of(tab) == ""
            daemon.start()
            missing = tab.event("stage", up=True)["missing"]
            assert missing["from"] == down["since"] < missing["to"]
            eventually(lambda: state_of(tab) == "FAULT", 60.0)

            eventually(lambda: tab.call("/v1/reset", stage="rig")["ok"])
            eventually(lambda: tab.call("/v1/arm", stage="rig")["ok"])
            assert "error" in daemon.ask("POST", "reset", {}).json()
            metrics = browser.request("GET", f"/metrics?token={browser.token}").text
            assert 'piezod_lease_held{stage="rig"} 1' in metrics

        eventually(lambda: daemon.ask("POST", "lease", {}).status_code == 200, 10.0)
        assert daemon.status()["state"] == "READY"
        daemon.do("stop")


def test_ctrl_c_ends_the_server_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The server ends with 0 while a tab is open; as a service it prints no token: it is logged."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("RUNTIME_DIRECTORY", f"{tmp_path}:/elsewhere")
    with forked("web", "--port", "0") as process:
        line, token = process.stdout.readline(), (tmp_path / "token").read_text()
        browser = Browser(urlsplit(line.split()[0]).port or 0, token)
        with browser.tab() as tab:
            assert tab.ask(do="stages")["result"]["stages"] == []
            assert f"with the token in {tmp_path}/token" in line
            assert token not in line
            assert (tmp_path / "token").stat().st_mode & 0o137 == 0
            process.send_signal(signal.SIGINT)
            assert process.wait(20.0) == 0
