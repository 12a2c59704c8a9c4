"""The work of `piezod acceptance`."""

import json
import platform
import re
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import typer

import piezod
from piezod.cli.devices.owned_stage import owning
from piezod.cli.devices.probe_run import document
from piezod.commission.probe import probe
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.daemon.clock import MonotonicClock
from piezod.daemon.loop.machine import measure_machine
from piezod.devices import registry
from piezod.devices.evidence import profile_of
from piezod.devices.wiring import pairs_of
from piezod.errors import DataError, DeviceUnavailableError
from piezod.messages.documents import plain
from piezod.records.atomic import replacing

FORMAT: Final = "piezod acceptance 1"
_NAMESPACE: Final = "piezod"


def run(
    config: Path,
    device: str | None,
    *,
    by: str,
    key: Path,
    commissioned: Path | None,
    faults: Sequence[str],
    out: Path | None,
) -> Path:
    """Inspect a device, write its record and sign it; return the path of the record.

    Raises:
        DeviceUnavailableError: If the device is absent.
        DataError: If the commissioning cannot be read, or the record cannot be signed.
    """
    stage = load_daemon(config, registry)
    name = _device_of(stage, device)
    steps = None if commissioned is None else _commissioned(commissioned)
    with owning(config):
        found = probe(stage, pairs_of(stage.axes), MonotonicClock())[name]
    if found.error or found.identity is None:
        raise DeviceUnavailableError(f"device {name}: {found.error}")
    options = stage.devices[name].options
    record = {
        "format": FORMAT,
        "driver": found.driver,
        "profile": profile_of(found.driver, options),
        "by": by,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "piezod": f"{piezod.__version__} ({piezod.build()})",
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "device": document(found),
        "machine": measure_machine(stage)._asdict(),
        "commissioned": steps,
        "faults": list(faults),
    }
    model = re.sub(r"[^A-Za-z0-9.-]+", "_", found.identity.model)
    path = out or Path(f"{found.driver}-{model}.json")
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(plain(record), indent=2, allow_nan=False) + "\n", "utf-8")
    _sign(path, key)
    return path


def _device_of(stage: DaemonConfig, device: str | None) -> str:
    known = ", ".join(stage.devices)
    if device is None and len(stage.devices) > 1:
        raise typer.BadParameter(f"name one of the devices {known}", param_hint="--device")
    name = device or next(iter(stage.devices))
    if name not in stage.devices:
        raise typer.BadParameter(
            f"no such device (got {name}), known: {known}", param_hint="--device"
        )
    return name


def _commissioned(path: Path) -> dict[str, Any]:
    """Return what `piezod commission --json` has printed, without the path on that machine."""
    try:
        found = json.loads(path.read_text("utf-8"))
        return {key: found[key] for key in ("axis", "found", "not_done")}
    except (ValueError, KeyError, TypeError) as error:
        what = f"{path} has no output of `piezod commission --json` ({error!r}): redirect it there"
        raise DataError(what) from error


def _sign(path: Path, key: Path) -> None:
    """Sign a file with a key of SSH; the signature is in FILE.sig."""
    signature = path.with_name(f"{path.name}.sig")
    signature.unlink(missing_ok=True)
    command = ("ssh-keygen", "-Y", "sign", "-f", str(key), "-n", _NAMESPACE, str(path))
    try:
        # A key with a passphrase asks for it on the terminal.
        ended = subprocess.run(command, check=False, stderr=subprocess.PIPE, text=True)  # noqa: S603 - no shell
    except FileNotFoundError as error:
        raise DataError("ssh-keygen is missing: sudo apt install openssh-client") from error
    if ended.returncode:
        raise DataError(f"{path} was not signed: {ended.stderr.strip()}; give a private key")
