"""TLS: the certificate of the server, and where it must have one."""

import ssl
import time
from ipaddress import ip_address
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from piezod.config.private_files import check_private
from piezod.errors import PiezodError
from piezod.given_file import read_given
from piezod.service_view import service_hint

_MOST_BYTES: Final = 1_000_000
_SOON_DAYS: Final = 30
_DAY_S: Final = 86_400
_DATE: Final = "%Y-%m-%d %H:%M UTC"
_HOW: Final = "docs/remote.md has the command that makes them"


class Certificate(NamedTuple):
    """The certificate of a server."""

    #: The certificate, or several from that of the server to that of the authority (PEM).
    file: Path
    key: Path  #: Its private key (PEM), which only the user of the server and his group may read.


def check_certificate(certificate: Certificate) -> str:
    """Check that a server can use a certificate; return a warning if it expires soon, or "".

    Raises:
        PiezodError: If others can read the key, it has a passphrase, or does not fit, or if the
            certificate is not valid at present.
        DataError: If one is no regular file, or too large.
        OSError: If a file cannot be read.
    """
    for file in certificate:
        _check_readable(file)
    check_private(certificate.key)
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate.file, certificate.key, password=_refuse_passphrase)
    except ssl.SSLError as error:
        files = f"{certificate.file} and {certificate.key}"
        what = f"{files} are no certificate and its key in PEM form ({error.reason})"
        raise PiezodError(f"{what}; {_HOW}") from error
    begin_s, end_s = _validity(certificate.file)
    now_s = time.time()
    if not begin_s <= now_s < end_s:
        begin, end = (time.strftime(_DATE, time.gmtime(each)) for each in (begin_s, end_s))
        raise PiezodError(
            f"{certificate.file}: the certificate is valid from {begin} to {end}, and this machine "
            f"has {time.strftime(_DATE, time.gmtime(now_s))}: browsers and clients refuse it; make "
            f"a new one ({_HOW}), or set the clock"
        )
    if (days := (end_s - now_s) / _DAY_S) > _SOON_DAYS:
        return ""
    return (
        f"{certificate.file}: the certificate expires in {days:.0f} days, and then the page does "
        "not start any more; make a new one"
    )


def _check_readable(file: Path) -> None:
    try:
        read_given(file, _MOST_BYTES)
    except OSError as error:
        if hint := service_hint(file):
            raise PiezodError(f"{file}: {error.strerror}{hint}") from error
        raise


def _validity(file: Path) -> tuple[float, float]:
    """Return begin and end of the validity of the first certificate of a file, in Unix time."""
    # There is no public function for a certificate that no authority has to vouch for.
    found = ssl._ssl._test_decode_cert(file)  # type: ignore[attr-defined]  # noqa: SLF001 - see above
    return (
        float(ssl.cert_time_to_seconds(found["notBefore"])),
        float(ssl.cert_time_to_seconds(found["notAfter"])),
    )


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
