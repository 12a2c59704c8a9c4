"""All that devices and daemons need, with kernels loaded: what `tests.forked` forks from."""

import rich.console  # noqa: F401 - to have them imported is all that these are for

import piezod.cli.emulate
import piezod.cli.output
import piezod.cli.run
import piezod.daemon.supervisor.run
import piezod.daemon.supervisor.supervisor
import piezod.devices.emulators
import piezod.web.server  # noqa: F401 - likewise
from piezod.cli.emulate_parts import bench, default_rig

with bench(default_rig(1), None):
    pass
