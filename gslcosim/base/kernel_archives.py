"""Archives of compiled kernels in our packages: made by `make dist`, moved into the cache on first use.

An archive has the files of one package for one version of Python and one level of processors. Its name has the
hash of the kernels, so that a package whose code was changed since has none. Its contents are not signed: it is as
trustworthy as the code beside it.
"""

import contextlib
import os
import sys
import tarfile
from pathlib import Path

from gslcosim.base.extension_packages import find_extension_packages
from gslcosim.base.files import hold_lock
from gslcosim.base.kernel_cache import (
    NUMBA_VARIABLE,
    PROCESSOR_VARIABLE,
    get_code_roots,
    get_extensions_hash,
    get_mark_path,
    is_trusted,
    write_signed,
)

_FOLDER = "compiled"


def get_archive_path(package: str) -> Path:
    """Return the place of a package's archive for this Python, this level of processors, and its code as it is."""
    core = Path(os.environ[NUMBA_VARIABLE]).name.partition("-")[0]
    level = os.environ.get(PROCESSOR_VARIABLE, "native")
    name = ".".join(filter(None, (core, get_extensions_hash(package), sys.implementation.cache_tag, level, "tar.xz")))
    return get_code_roots()[package] / _FOLDER / name


def has_all_archives() -> bool:
    """Return whether the kernels of all our packages that have some came from archives."""
    return all(_get_mark(package).exists() for package in list_packages())


def unpack_archives() -> None:
    """Move the kernels of all archives into the cache, signed, unless that was done before.

    Kernels that are there already stay. A cache that cannot be written is left as it is.
    """
    for package in list_packages():
        archive, mark = get_archive_path(package), _get_mark(package)
        if not archive.is_file() or mark.exists():
            continue
        with contextlib.suppress(OSError):
            mark.parent.mkdir(parents=True, exist_ok=True)
            with hold_lock(mark.with_suffix(".lock")):
                if not mark.exists() and is_trusted(archive.stat()):
                    _unpack(archive, mark.parents[1])
                    mark.touch()


def list_packages() -> list[str]:
    """Return the names of our packages that have kernels."""
    extensions = find_extension_packages()
    return [name for name in get_code_roots() if name not in extensions or get_extensions_hash(name)]


def _get_mark(package: str) -> Path:
    return get_mark_path(package, get_extensions_hash(package))


def _unpack(archive: Path, folder: Path) -> None:
    with tarfile.open(archive) as members:
        for member in members:
            place = folder / member.name
            if (content := members.extractfile(member)) is None or place.exists():
                continue
            place.parent.mkdir(exist_ok=True)
            write_signed(str(place), content.read())
