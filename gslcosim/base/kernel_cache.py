"""Cache of compiled numba kernels: outside the checkout, never stale, and loaded only with a signature of ours.

Numba's index and data files are pickles, which run code when they are loaded. Each ends with a signature, whose key
lies in gslcosim's cache, which no agent in a sandbox can read or write. A file that is not ours, that others may write,
or whose signature is wrong counts as absent: its kernel is compiled again.
"""

import contextlib
import errno
import hashlib
import importlib.abc
import importlib.machinery
import importlib.util
import os
import stat
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from gslcosim.base.extension_packages import find_extension_packages

PACKAGE_DIR = Path(__file__).resolve().parents[1]
NUMBA_VARIABLE = "NUMBA_CACHE_DIR"
# The code whose kernels are in the folder of `NUMBA_VARIABLE`; absent for a folder that the user has chosen.
OWNER_VARIABLE = "NUMBA_CACHE_OF_GSLCOSIM"
# The hash of the kernels of all extensions, beside that folder.
EXTENSIONS_VARIABLE = "GSLCOSIM_EXTENSION_KERNELS"
# Set for agents in a sandbox, which have a disposable cache of their own, and no key.
UNCHECKED_VARIABLE = "GSLCOSIM_UNCHECKED_KERNELS"
_CACHING = "numba.core.caching"
# Part of the hash, so that versions with other layouts of files use other folders.
_LAYOUT = b"signed/1"
# Variables that change the code numba compiles and are not part of numba's own key.
_COMPILER_VARIABLES = (
    "NUMBA_OPT", "NUMBA_LOOP_VECTORIZE", "NUMBA_SLP_VECTORIZE", "NUMBA_ENABLE_AVX", "NUMBA_BOUNDSCHECK",
)  # fmt: skip
# Marks of files whose text goes into compiled code.
_KERNEL_MARKS = (b"numba", b"njit", b"scalar_kernel")
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_CANNOT_BE_WRITTEN = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOENT)
_KEY_FILE = "kernels.key"
_SIGNATURE_BYTES = 32
_KEY_BYTES = 32
_READ = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


def get_cache_root() -> Path:
    """Return the folder for everything gslcosim computes once and keeps.

    `GSLCOSIM_CACHE` overrides it; otherwise `$XDG_CACHE_HOME/gslcosim` or `~/.cache/gslcosim`.
    """
    if chosen := os.environ.get("GSLCOSIM_CACHE"):
        return Path(chosen).expanduser()
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "gslcosim"


def use_kernel_cache() -> None:
    """Point numba at a cache folder that changes with every kernel, and make it load signed files only.

    Numba keys a cached kernel by its own file only, so a kernel that calls one of another file would keep the old
    callee. The folder's name therefore includes a hash of all files of the core with kernels, and of the compiler's
    settings, such as the optimisation level. Kernels of extensions and agents are in subfolders whose names include a
    hash of all extensions, so that the core's kernels stay when an extension is installed or changed. Child processes
    inherit the folder; one that runs another copy of the code chooses its own.
    """
    owner = os.environ.get(OWNER_VARIABLE)
    if NUMBA_VARIABLE not in os.environ or owner not in (None, str(PACKAGE_DIR)):
        os.environ[OWNER_VARIABLE] = str(PACKAGE_DIR)
        os.environ[NUMBA_VARIABLE] = str(_choose_folder(get_cache_root() / "numba" / _hash_kernels(_get_core_roots())))
        os.environ[EXTENSIONS_VARIABLE] = _hash_kernels(find_extension_packages())
    if UNCHECKED_VARIABLE in os.environ:
        return
    if (loaded := sys.modules.get(_CACHING)) is not None:
        _sign_files(loaded)
    elif not any(isinstance(finder, _CachingFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _CachingFinder())


def is_trusted(status: os.stat_result) -> bool:
    """Return whether only accounts that may change our code anyway own a file or folder, and may write to it."""
    if not hasattr(os, "geteuid"):
        return True
    owners = (os.geteuid(), 0, PACKAGE_DIR.stat().st_uid)
    return status.st_uid in owners and not status.st_mode & _WRITABLE_BY_OTHERS


def get_key_path() -> Path:
    """Return the file with the key of the signatures, in the cache that holds the kernels.

    A process that inherits the folder of kernels but has another cache, as by `GSLCOSIM_CACHE`, uses the key of the
    kernels: with a key of its own it would compile and sign all of them again, and so would the others.
    """
    if OWNER_VARIABLE in os.environ and NUMBA_VARIABLE in os.environ:
        return Path(os.environ[NUMBA_VARIABLE]).parents[1] / _KEY_FILE
    return get_cache_root() / _KEY_FILE


def get_code_roots() -> dict[str, Path]:
    """Return the folders of our packages and of installed extensions by their names."""
    return _get_core_roots() | find_extension_packages()


@cache
def _get_core_roots() -> dict[str, Path]:
    services = importlib.util.find_spec("gslcosim_services")
    places = services.submodule_search_locations if services is not None else None
    roots = {"gslcosim": PACKAGE_DIR}
    if places:
        roots["gslcosim_services"] = Path(places[0]).resolve()
    return roots


def get_kernels_folder_name(code: Path, plain_name: str) -> str:
    """Return the name of the cache folder with the compiled kernels of a folder's modules.

    The folder of a package is named after it, so that all installations of one version share its kernels; any other has
    `plain_name`, numba's own name for it.
    """
    if OWNER_VARIABLE not in os.environ:
        return plain_name
    package = next((name for name, root in get_code_roots().items() if code.is_relative_to(root)), "")
    name = ".".join((package, *code.relative_to(get_code_roots()[package]).parts)) if package else plain_name
    return name if package in _get_core_roots() else f"{name}_{os.environ.get(EXTENSIONS_VARIABLE, '')}"


def _hash_kernels(roots: Mapping[str, Path]) -> str:
    digest = hashlib.blake2b(_LAYOUT, digest_size=8)
    for name in _COMPILER_VARIABLES:
        if name in os.environ:
            digest.update(f"{name}={os.environ[name]}\0".encode())
    for package, root in roots.items():
        for path in sorted(_iter_modules(str(root))):
            with open(path, "rb") as file:  # noqa: PTH123 - a path of 700
                content = file.read()
            if any(mark in content for mark in _KERNEL_MARKS):
                digest.update(f"{package}{path.removeprefix(str(root))}\0".encode())
                digest.update(content)
    return digest.hexdigest()


# Twice as fast as Path.rglob, in the start of every command.
def _iter_modules(folder: str) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                yield entry.path
            elif entry.is_dir(follow_symlinks=False) and entry.name != "__pycache__":
                yield from _iter_modules(entry.path)


# A folder that another account has created first, as when root uses the home of a user, is left to that account.
def _choose_folder(folder: Path) -> Path:
    try:
        status = folder.lstat()
    except OSError:
        return folder
    if stat.S_ISDIR(status.st_mode) and is_trusted(status):
        return folder
    if stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid():
        folder.chmod(stat.S_IMODE(status.st_mode) & ~_WRITABLE_BY_OTHERS)
        return folder
    return folder.with_name(f"{folder.name}-{os.geteuid()}")


class _CachingFinder(importlib.abc.MetaPathFinder):
    # Importing numba takes a third of a second, which most commands do not need, so its class is replaced on import.

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != _CACHING:
            return None
        sys.meta_path.remove(self)
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _CachingLoader(spec.loader)
        return spec


class _CachingLoader(importlib.abc.Loader):
    def __init__(self, loader: importlib.abc.Loader) -> None:
        self._loader = loader

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        self._loader.exec_module(module)
        _sign_files(module)
        # The time of last use decides on eviction.
        with contextlib.suppress(OSError):
            os.utime(os.environ[NUMBA_VARIABLE])


def _sign_files(caching: Any) -> None:
    if not hasattr(caching.IndexDataCacheFile, "is_signed"):
        caching.IndexDataCacheFile = _build_signed_class(caching.IndexDataCacheFile)
        chosen = _locator_class(caching.UserProvidedCacheLocator)
        caching.CacheImpl._locator_classes = [chosen, *caching.CacheImpl._locator_classes]


# Numba skips a folder that it cannot write, even if all kernels are there to be read, and writes beside the sources, or
# gives up.
def _locator_class(plain: type[Any]) -> type[Any]:
    class ReadableCacheLocator(plain):
        """Numba's locator of the configured cache folder, writable or not."""

        @classmethod
        def get_suitable_cache_subpath(cls, py_file: str) -> str:
            return get_kernels_folder_name(Path(py_file).resolve().parent, super().get_suitable_cache_subpath(py_file))

        def ensure_cache_path(self) -> None:
            with contextlib.suppress(OSError):
                super().ensure_cache_path()

    return ReadableCacheLocator


def _build_signed_class(plain: type[Any]) -> type[Any]:
    import pickle

    class SignedCacheFile(plain):
        """Numba's index and data files with a signature at the end of each, which numba's own class ignores."""

        is_signed = True

        def _load_index(self) -> dict[Any, str]:
            body = _read_signed(self._index_path)
            version = pickle.dumps(self._version, protocol=-1)
            if body is None or not body.startswith(version):
                return {}
            stamp, overloads = pickle.loads(body[len(version) :])
            return overloads if stamp == self._source_stamp else {}

        def _save_index(self, overloads: dict[Any, str]) -> None:
            version = pickle.dumps(self._version, protocol=-1)
            _write_signed(self._index_path, version + self._dump((self._source_stamp, overloads)))

        def _load_data(self, name: str) -> Any:
            body = _read_signed(self._data_path(name))
            if body is None:
                # Numba compiles a missing entry again.
                raise FileNotFoundError(self._data_path(name))
            return pickle.loads(body)

        def _save_data(self, name: str, data: Any) -> None:
            _write_signed(self._data_path(name), self._dump(data))

    return SignedCacheFile


def _read_signed(path: str) -> bytes | None:
    if (data := _read_trusted(path)) is None:
        return None
    body, signature = data[:-_SIGNATURE_BYTES], data[-_SIGNATURE_BYTES:]
    return body if is_signed(_name_place(path), body, signature, Path(path)) else None


# Without a key no process could load it again. Without write access the kernel is compiled again next time.
def _write_signed(path: str, body: bytes) -> None:
    if (signature := sign(_name_place(path), body)) is not None:
        try:
            _replace(path, body + signature, 0o644)
        except OSError as error:
            if error.errno not in _CANNOT_BE_WRITTEN:
                raise


def _name_place(path: str) -> str:
    return "/".join(Path(path).parts[-2:])


def sign(place: str, body: bytes) -> bytes | None:
    """Return the signature of data with the key of the cache; None without a key.

    Args:
        place: Name of the file with the data, so that no signed file can replace another.
        body: The data.
    """
    if (key := _load_or_create_key(get_key_path())) is None:
        return None
    hasher = hashlib.blake2b(f"{place}\0".encode(), key=key, digest_size=_SIGNATURE_BYTES)
    hasher.update(body)
    return hasher.digest()


def is_signed(place: str, body: bytes, signature: bytes, path: Path) -> bool:
    """Return whether data are signed with the key of the cache or, without a readable key, are in a file of root."""
    import hmac

    if (expected := sign(place, body)) is not None:
        return hmac.compare_digest(expected, signature)
    # Only root reads the key of a cache that root has filled for all.
    return hasattr(os, "geteuid") and os.geteuid() != 0 and path.lstat().st_uid == 0


# None if there is no key and none can be created: then each process compiles its kernels.
@cache
def _load_or_create_key(path: Path) -> bytes | None:
    if (kept := _read_key(path)) is not None:
        return kept
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_symlink() or path.exists():
            # A key that others have written, or may have read, signs nothing.
            _replace(str(path), os.urandom(_KEY_BYTES), 0o600)
        else:
            _link_new(path, os.urandom(_KEY_BYTES))
    return _read_key(path)


def _read_key(path: Path) -> bytes | None:
    key = _read_trusted(str(path))
    return key if key is not None and len(key) == _KEY_BYTES else None


def _read_trusted(path: str) -> bytes | None:
    try:
        descriptor = os.open(path, _READ)
    except OSError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        return file.read() if stat.S_ISREG(status.st_mode) and is_trusted(status) else None


def _replace(path: str, data: bytes, mode: int) -> None:
    beside = _write_temporary(path, data, mode)
    try:
        beside.replace(path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise


# Of several processes that start at once one creates the key, and all read that.
def _link_new(path: Path, data: bytes) -> None:
    beside = _write_temporary(str(path), data, 0o600)
    try:
        path.hardlink_to(beside)
    except FileExistsError:
        return
    finally:
        beside.unlink(missing_ok=True)


def _write_temporary(path: str, data: bytes, mode: int) -> Path:
    beside = Path(f"{path}.tmp.{os.urandom(8).hex()}")
    descriptor = os.open(beside, _CREATE, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
    except OSError:
        beside.unlink(missing_ok=True)
        raise
    return beside
