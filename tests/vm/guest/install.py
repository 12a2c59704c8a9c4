"""The wheel and the files of the service."""

import json
import subprocess

from tests.vm.guest import compiled
from tests.vm.guest.shell import PIEZOD, CheckError, need, run


def wheel_is_installed() -> str:
    """Install the wheel with the guest's pip, without a network."""
    try:
        compiled.install()
    except subprocess.CalledProcessError as error:
        raise CheckError(error.stdout + error.stderr) from error
    compiled.unpack()
    return run(f"{PIEZOD} --version")


def service_is_installed() -> str:
    """Run `piezod install-service` and the commands that it names."""
    installed = json.loads(run(f"{PIEZOD} install-service --json"))
    for command in installed["next"]:
        if command.startswith(("systemd-", "udevadm", "systemctl daemon-reload")):
            run(command)
    for name in installed["written"]:
        if name.endswith(".service"):
            said = run(f"systemd-analyze verify --man=no {name} 2>&1")
            need(not said, f"systemd-analyze verify {name}: {said}")
    return f"{len(installed['written'])} files"
