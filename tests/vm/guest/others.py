"""The other units, and the removal of all of them."""

import json
import socket
import urllib.request
from pathlib import Path
from typing import Final

from tests.vm.guest.buses import CAN, USB
from tests.vm.guest.service import STAGE
from tests.vm.guest.shell import PIEZOD, attempt, need, run, shows, wait_until

TOKEN: Final = Path("/run/piezod-web/token")
PAGE: Final = "http://127.0.0.1:8080"
EPICS_PORT: Final = 5064


def page_is_served() -> str:
    """Start both units, and get the page with its token."""
    run("systemctl start piezod-web piezod-ioc")
    wait_until(TOKEN.exists, f"{TOKEN}", 180.0)
    wait_until(lambda: _listens(8080), "the page listens", 180.0)
    address = f"{PAGE}/?token={TOKEN.read_text('ascii').strip()}"
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    text = opener.open(address, timeout=60).read().decode()
    need("<html" in text, f"no page: {text[:200]}")
    mode = oct(TOKEN.stat().st_mode & 0o777)
    return f"{len(text)} bytes; the token has the mode {mode}"


def ioc_serves() -> str:
    """The unit of the IOC, which lists the records of the stages that run, serves them.

    Then both units end: an emulated processor is too slow for the other checks beside them.
    """
    wait_until(lambda: _listens(EPICS_PORT), f"the IOC listens at {EPICS_PORT}", 300.0)
    restarts = shows("piezod-ioc", "NRestarts")
    need(shows("piezod-ioc", "ActiveState") == "active", "the unit is not active")
    run("systemctl stop piezod-web piezod-ioc")
    return f"port {EPICS_PORT}, {restarts} restarts"


def _listens(port: int) -> bool:
    with socket.socket() as wire:
        return wire.connect_ex(("127.0.0.1", port)) == 0


def uninstall_is_refused() -> str:
    """While a stage runs, or another is enabled, `install-service --uninstall` removes nothing."""
    run(f"systemctl enable {STAGE.unit}")
    ended = attempt(f"{PIEZOD} install-service --uninstall")
    need(ended.returncode == 1, f"the exit code is {ended.returncode}")
    for unit in (CAN.unit, STAGE.unit):
        need(f"{unit}.service" in ended.stderr, f"it says {ended.stderr!r}, without {unit}")
    return ended.stderr.strip().splitlines()[0]


def uninstall_removes_all() -> str:
    """After `systemctl disable --now` nothing of the service is left."""
    stages = f"{STAGE.unit} {USB.unit} {CAN.unit}"
    run(f"systemctl disable --now {stages} piezod-web piezod-ioc")
    removed = json.loads(run(f"{PIEZOD} install-service --uninstall --json"))
    run("systemctl daemon-reload")
    folders = "/usr/lib/systemd /etc/systemd /usr/lib/udev /usr/lib/sysusers.d /usr/lib/tmpfiles.d"
    left = run(f"find {folders} -name '*piezod*' ! -name 'piezod-vm*'")
    need(not left, f"left: {left}")
    return f"{len(removed['removed'])} files"
