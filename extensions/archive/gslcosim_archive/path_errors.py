"""Errors of folders that cannot be written."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gslcosim.base.errors import build_path_error


@contextmanager
def reporting_path_errors(place: str, expected: str, *, path: Path | str) -> Iterator[None]:
    """Turn what the machine refuses inside into `build_path_error`."""
    try:
        yield
    except OSError as error:
        raise build_path_error(error, place, expected, path=path) from error
