"""TLS: the certificate of the server, and where it must have one."""

import ssl
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple, NoReturn

from piezod.config.private_files import check_private
from piezod.errors import PiezodError


class Certificate(NamedTuple):
    """The certificate of a server.

    Attributes:
        file: The certificate, or several from that of the server to that of the authority (PEM).
        key: Its private key (PEM), which only the user of the server and his group may read.
    """

    file: Path
    key: Path


def check_certificate(certificate: Certificate) -> None:
    """Check that a server can use a certificate.

    Raises:
        PiezodError: If others can read the key, it has a passphrase, or does not fit.
        OSError: If a file cannot be read.
    """
    check_private(certificate.key)
    certificate.file.read_bytes()  # for an error with the name of the file
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate.file, certificate.key, password=_refuse_passphrase)
    except ssl.SSLError as error:
        files = f"{certificate.file} and {certificate.key}"
        what = f"{files} are no certificate and its key in PEM form ({error.reason})"
        raise PiezodError(f"{what}; docs/remote.md has the command that makes them") from error


def require_encryption(address: str, name: str) -> None:
    """Refuse to listen without TLS on an address that other computers reach.

    Args:
        address: The address.
        name: The same as the user gave it, for the text.

    Raises:
        PiezodError: If other computers reach it.
    """
    if not ip_address(address.partition("%")[0]).is_loopback:
        raise PiezodError(
            f"cannot listen on {name} without encryption: whoever reads the network could move "
            "the stage; add --certificate FILE --key FILE (docs/remote.md has the command that "
            "makes them), or listen on 127.0.0.1 and forward the port with `ssh -L`"
        )


def _refuse_passphrase() -> NoReturn:
    raise PiezodError(
        "the key has a passphrase; make a key without: openssl pkey -in KEY -out NEW_KEY"
    )
