"""Errors of one run among several say which one."""

from collections.abc import Iterator
from contextlib import contextmanager

from piezod.errors import ClientError, DataError


@contextmanager
def prefix_errors(run: str) -> Iterator[None]:
    """Put the name of a run, such as case and mode, before the text of an error."""
    try:
        yield
    except ClientError as error:
        raise type(error)(f"{run}: {error.what}", error.remedy, error.code) from error
    except DataError as error:
        raise DataError(f"{run}: {error}") from error
