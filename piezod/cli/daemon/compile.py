"""`piezod compile`: the kernels of the loop, compiled once."""

import typer

from piezod.cli.daemon.shipped import shipped


def compile_kernels() -> None:
    """Compile the kernels of the loop for this processor, before the first start.

    It takes half a minute after an installation, and a second if they are compiled. The service
    does it before each start. The kernels are kept in `NUMBA_CACHE_DIR`, or else beside the code or
    in the cache of this user.
    """
    # What has kernels takes long to import.
    from piezod.config.daemon import load_daemon
    from piezod.control.warm_up import warm_up
    from piezod.devices import registry
    from piezod.devices.wiring import construct, pairs_of
    from piezod.jit import compilations

    config = load_daemon(shipped("config") / "simulated.yaml", registry)
    warm_up(config)
    for device in construct(config.devices, pairs_of(config.axes), config.seed).values():
        device.open()
        device.activate(0)
        device.close()
    compiled = compilations()
    typer.echo(f"Kernels compiled: {compiled}" if compiled else "All kernels are compiled already")
