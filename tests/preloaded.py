"""All that devices and daemons need, with kernels loaded: what `tests.forked` forks from."""

import gc
from errno import EPERM

import rich.console  # noqa: F401 - to have them imported is all that these are for

import piezod.cli.daemon.run
import piezod.cli.devices.emulate
import piezod.cli.devices.emulate_run
import piezod.cli.main
import piezod.cli.output
import piezod.daemon.loop.process
import piezod.daemon.safe.rescuer
import piezod.daemon.supervisor.run
import piezod.daemon.supervisor.supervisor
import piezod.devices.emulators
import piezod.web.server  # noqa: F401 - likewise
from piezod.cli.devices.emulate_parts import bench, default_rig
from piezod.control.warm_up import warm_up
from piezod.daemon.loop import realtime
from piezod.telemetry import requests_codec
from tests.control.rig_stage import shipped_config


def _refuse(_: object) -> None:
    """Refuse to lock memory, as the kernel does to most users: a fork would have to copy it all."""
    raise PermissionError(EPERM, "not in a fork")


with bench(default_rig(1), None):
    requests_codec.warm_up()
    warm_up(shipped_config())
vars(realtime)["lock_memory"] = _refuse
gc.freeze()  # else the first collection in each fork copies all memory
