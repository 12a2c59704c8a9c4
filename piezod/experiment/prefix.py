"""Errors of one run or file among several say which one."""

from collections.abc import Iterator
from contextlib import contextmanager

from piezod.errors import ClientError, DataError


@contextmanager
def prefix_errors(name: str) -> Iterator[None]:
    """Put the name of a run or file, such as case and mode, before the text of an error."""
    try:
        yield
    except ClientError as error:
        raise type(error)(f"{name}: {error.what}", error.remedy, error.code) from error
    except DataError as error:
        raise DataError(f"{name}: {error}") from error
