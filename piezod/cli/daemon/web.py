"""`piezod web`: the page of this machine's stages, and their API for other computers."""

from pathlib import Path
from typing import Annotated

import typer


def web(
    port: Annotated[
        int, typer.Option(metavar="N", min=0, max=65535, help="TCP port; 0 for any free one.")
    ] = 8080,
    host: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Name or address of this machine to listen on; 0.0.0.0 for all. Addresses that "
            "other computers reach need a certificate.",
        ),
    ] = "127.0.0.1",
    certificate: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Certificate (PEM) for TLS; with its --key."),
    ] = None,
    key: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Private key of the certificate (PEM, no passphrase)."),
    ] = None,
    tokens: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of lasting tokens, `user` and `viewer`, which are made if missing. "
            "Default: a token for this start.",
        ),
    ] = None,
    public_url: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Address of the page at a reverse proxy, as https://lab.example/piezod/.",
        ),
    ] = None,
) -> None:
    """Serve a page with all stages of this machine, and their API, until Ctrl-C.

    Prints the address of the page, with a token that a browser needs. The page acts as the user
    of this command. Other computers reach the stages over TLS.
    """
    # The server takes long to import.
    from piezod.web.encryption import Certificate
    from piezod.web.public_url import PublicUrl
    from piezod.web.server import WebPlan, serve

    if (certificate is None) != (key is None):
        raise typer.BadParameter("--certificate and --key need each other")
    encryption = Certificate(certificate, key) if certificate and key else None
    public = None if public_url is None else PublicUrl.of(public_url)
    serve(
        WebPlan(host, port, encryption, tokens, public),
        announce=typer.echo,
        warn=lambda text: typer.echo(f"! {text}", err=True),
    )
