"""Files with secrets: tokens, and the keys of certificates."""

import os
import secrets
import stat
from pathlib import Path
from typing import Final

from piezod.errors import PiezodError
from piezod.given_file import read_given

SHORTEST: Final = 20
"""Least number of characters of a token; a shorter one can be guessed."""

_MOST_BYTES: Final = 65_536


def check_private(file: Path) -> Path:
    """Return the path of a file with a secret, if only its user and group can use it.

    Raises:
        PiezodError: If other users can.
        OSError: If there is no such file.
    """
    mode = stat.S_IMODE(file.stat().st_mode)
    if mode & stat.S_IRWXO:
        what = f"{file}: other users of this machine can use this file (mode {mode:04o})"
        raise PiezodError(f"{what}; allow it to its owner only: chmod 600 {file}")
    return file


def read_token(file: Path) -> str:
    """Return the token in a file: all its text, without blanks around it.

    Raises:
        PiezodError: If the file is not private, or there is no token in it.
        OSError: If the file cannot be read.
    """
    token = read_given(check_private(file), _MOST_BYTES).decode(errors="replace").strip()
    return checked_token(token, str(file))


def checked_token(token: str, source: str) -> str:
    """Return a token, if it can be one. The text of the error does not contain it.

    Args:
        token: The token.
        source: The file or variable that it is from, for the text.

    Raises:
        PiezodError: If it is too short, or has characters that a header may not have.
    """
    if len(token) < SHORTEST or not (token.isascii() and token.isprintable() and " " not in token):
        what = (
            f"{source}: this is no token: at least {SHORTEST} letters, digits and signs, no blank"
        )
        raise PiezodError(f"{what}; copy one that `piezod web` has made")
    return token


def kept_token(file: Path) -> str:
    """Return the token in a file, which is made with a new token if there is none.

    Raises:
        PiezodError: If other users can use the file, or another one has made it, or there is no
            token in it.
        OSError: If the file can be neither read nor made.
    """
    try:
        number = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        if (owner := file.stat().st_uid) not in (os.getuid(), 0):
            what = f"{file}: another user (number {owner}) has made this token, and knows it"
            raise PiezodError(f"{what}; use a folder of your own") from None
        return read_token(file)
    with os.fdopen(number, "w", encoding="ascii") as opened:
        opened.write(f"{secrets.token_urlsafe(32)}\n")
    return read_token(file)
