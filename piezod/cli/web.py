"""`piezod web`: the page of this machine's stages."""

from typing import Annotated

import typer


def web(
    port: Annotated[
        int, typer.Option(metavar="N", min=0, max=65535, help="TCP port; 0 for any free one.")
    ] = 8080,
    host: Annotated[
        str, typer.Option(metavar="NAME", help="Name or address of this machine to listen on.")
    ] = "127.0.0.1",
) -> None:
    """Serve a page with all stages of this machine until Ctrl-C.

    Prints the address of the page, with a token that a browser needs. The page acts as the user
    of this command.
    """
    from piezod.web.server import serve

    serve(host, port, announce=typer.echo)
