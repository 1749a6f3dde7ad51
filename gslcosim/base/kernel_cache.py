"""Cache of compiled numba kernels: outside the checkout, never stale, and loaded only with a signature of ours.

Numba's index and data files are pickles, which run code when they are loaded. Each ends with a signature, whose key
lies in gslcosim's cache, which no agent in a sandbox can read or write. A file that is not ours, that others may write,
or whose signature is wrong counts as absent: its kernel is compiled again.

Kernels are compiled for a level of processors (x86-64-v3 or v2) in place of the one at hand, so that those of a wheel
serve everywhere; `gslcosim.base.kernel_archives` takes them from there.
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
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

from gslcosim.base.extension_packages import find_extension_packages

PACKAGE_DIR = Path(__file__).resolve().parents[1]
NUMBA_VARIABLE = "NUMBA_CACHE_DIR"
# The code whose kernels are in the folder of `NUMBA_VARIABLE`; absent for a folder that the user has chosen.
OWNER_VARIABLE = "NUMBA_CACHE_OF_GSLCOSIM"
# The hash of the kernels of each extension, beside that folder, as NAME=HASH,…; agents get variables of numba.
EXTENSIONS_VARIABLE = "NUMBA_CACHE_OF_EXTENSIONS"
# Set for agents in a sandbox, which have no key and keep nothing of what they compile.
UNCHECKED_VARIABLE = "GSLCOSIM_UNCHECKED_KERNELS"
# Beside the kernels: marks of packages and agents whose kernels are all there.
_MARKS_FOLDER = "marks"
PROCESSOR_VARIABLE = "NUMBA_CPU_NAME"
# LLVM's names for the features of a level of x86-64, and their flags in /proc/cpuinfo; each level has those above.
PROCESSOR_LEVELS = {
    "x86-64-v2": ("64bit cmov cx8 fxsr mmx sse sse2 sse3 ssse3 sse4.1 sse4.2 popcnt cx16 sahf",
                  "pni ssse3 sse4_1 sse4_2 popcnt cx16 lahf_lm"),
    "x86-64-v3": ("avx avx2 bmi bmi2 f16c fma lzcnt movbe xsave", "avx avx2 bmi1 bmi2 f16c fma abm movbe xsave"),
}  # fmt: skip
_CACHING = "numba.core.caching"
_ARRAY_MATH = "numba.np.arraymath"
_LINEAR_ALGEBRA = "scipy.linalg"
# Part of the hash, so that versions with other layouts of files use other folders.
_LAYOUT = b"signed/2"
# Variables that change the code numba compiles and are not part of numba's own key.
_COMPILER_VARIABLES = (
    "NUMBA_OPT", "NUMBA_LOOP_VECTORIZE", "NUMBA_SLP_VECTORIZE", "NUMBA_ENABLE_AVX", "NUMBA_BOUNDSCHECK",
)  # fmt: skip
# Marks of files whose text goes into compiled code.
_KERNEL_MARKS = (b"numba", b"njit", b"scalar_kernel")
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_CANNOT_BE_WRITTEN = (errno.EACCES, errno.EFBIG, errno.ENOENT, errno.EPERM, errno.EROFS)
_KEY_FILE = "kernels.key"
# Its bytes are locked, each for the kernels whose names hash to it, while a process compiles one.
_LOCK_FILE = "compiling.lock"
# A process that has stopped with a lock must not stop others.
_LOCK_TIMEOUT_S = 120.0
_LOCK_EVERY_S = 0.02
# The first processor's part of /proc/cpuinfo.
_CPUINFO_BYTES = 8192
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


def use_kernel_cache(fill: Callable[[], object] = lambda: None) -> None:
    """Point numba at a cache folder that changes with every kernel, and make it load signed files only.

    Numba keys a cached kernel by its own file only, so a kernel that calls one of another file would keep the old
    callee. The folder's name therefore includes a hash of all files of the core with kernels, and of the compiler's
    settings, such as the optimisation level. Kernels of an extension are in subfolders whose names include a hash of
    its own and of the extensions that it calls, those of agents in ones with a hash of all, so that the others stay
    when an extension is installed or changed. Child processes inherit the folder; one that runs another copy of the
    code chooses its own.

    Args:
        fill: Puts kernels that are compiled already into the folder, as soon as numba is imported.
    """
    owner = os.environ.get(OWNER_VARIABLE)
    if NUMBA_VARIABLE not in os.environ or owner not in (None, str(PACKAGE_DIR)):
        os.environ[OWNER_VARIABLE] = str(PACKAGE_DIR)
        os.environ[NUMBA_VARIABLE] = str(_choose_folder(get_cache_root() / "numba" / _hash_kernels(_get_core_roots())))
        hashes = _hash_extensions(find_extension_packages())
        os.environ[EXTENSIONS_VARIABLE] = ",".join(f"{name}={text}" for name, text in hashes.items())
    if PROCESSOR_VARIABLE not in os.environ and "NUMBA_CPU_FEATURES" not in os.environ:
        os.environ.update(build_processor_variables(_find_processor_level()))
    if (loaded := sys.modules.get(_CACHING)) is None:
        if not any(isinstance(finder, _NumbaFinder) for finder in sys.meta_path):
            loads = {_CACHING: partial(_load_caching, fill), _ARRAY_MATH: _load_without_scipy}
            sys.meta_path.insert(0, _NumbaFinder(loads))
    elif UNCHECKED_VARIABLE not in os.environ:
        _sign_files(loaded)


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


def build_processor_variables(level: str | None) -> dict[str, str]:
    """Return numba's variables for a level of `PROCESSOR_LEVELS`; none for None, which is the processor at hand."""
    if level is None:
        return {}
    levels = list(PROCESSOR_LEVELS)
    names = [name for each in levels[: levels.index(level) + 1] for name in PROCESSOR_LEVELS[each][0].split()]
    return {PROCESSOR_VARIABLE: level, "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in names)}


def _find_processor_level() -> str | None:
    try:
        with open("/proc/cpuinfo", "rb") as file:  # noqa: PTH123 - in the start of every command
            text = file.read(_CPUINFO_BYTES).decode(errors="replace")
    except OSError:
        return None
    line = next((line for line in text.splitlines() if line.startswith("flags")), "")
    return choose_processor_level(line.partition(":")[2].split())


def choose_processor_level(flags: Sequence[str]) -> str | None:
    """Return the highest of `PROCESSOR_LEVELS` that a processor with these flags of /proc/cpuinfo has, or None."""
    found = None
    for level, (_, needed) in PROCESSOR_LEVELS.items():
        if not set(flags).issuperset(needed.split()):
            break
        found = level
    return found


def get_kernels_folder_name(code: Path, plain_name: str) -> str:
    """Return the name of the cache folder with the compiled kernels of a folder's modules.

    The folder of a package is named after it, so that all installations of one version share its kernels; any other has
    `plain_name`, numba's own name for it.
    """
    if OWNER_VARIABLE not in os.environ:
        return plain_name
    package = _find_package(code)
    name = ".".join((package, *code.relative_to(get_code_roots()[package]).parts)) if package else plain_name
    return name if package in _get_core_roots() else f"{name}_{get_extensions_hash(package)}"


def get_extensions_hash(package: str = "") -> str:
    """Return the hash of the kernels of an extension and of those that it calls; without a name, of all extensions.

    It is empty for packages of the core, and for extensions without kernels.
    """
    text = os.environ.get(EXTENSIONS_VARIABLE, "")
    if package:
        return dict(word.split("=") for word in text.split(",") if word).get(package, "")
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


@cache
def _find_package(code: Path) -> str:
    return next((name for name, root in get_code_roots().items() if code.is_relative_to(root)), "")


def get_mark_path(name: str, kernels_hash: str) -> Path:
    """Return the file that is there once all kernels of an agent, or a package, with that hash are."""
    level = os.environ.get(PROCESSOR_VARIABLE, "native")
    mark = f"{name}.{kernels_hash}.{sys.implementation.cache_tag}.{level}"
    return Path(os.environ[NUMBA_VARIABLE]) / _MARKS_FOLDER / mark


# Files with kernels name the extensions whose kernels they call, in their imports.
def _hash_extensions(packages: Mapping[str, Path]) -> dict[str, str]:
    files = {name: _read_kernel_files(root) for name, root in packages.items()}
    files = {name: kernels for name, kernels in files.items() if kernels}
    called = {name: {other for other in files if _is_named(other, kernels)} for name, kernels in files.items()}
    for _ in files:
        called = {name: others.union(*(called[other] for other in others)) for name, others in called.items()}
    return {name: _hash_files({each: files[each] for each in sorted({name, *called[name]})}) for name in files}


def _is_named(package: str, kernels: Mapping[str, bytes]) -> bool:
    return any(package.encode() in content for content in kernels.values())


def _hash_kernels(roots: Mapping[str, Path]) -> str:
    return _hash_files({package: _read_kernel_files(root) for package, root in roots.items()})


def _hash_files(files: Mapping[str, Mapping[str, bytes]]) -> str:
    digest = hashlib.blake2b(_LAYOUT, digest_size=8)
    for name in _COMPILER_VARIABLES:
        if name in os.environ:
            digest.update(f"{name}={os.environ[name]}\0".encode())
    for package, kernels in files.items():
        for path, content in kernels.items():
            digest.update(f"{package}{path}\0".encode())
            digest.update(content)
    return digest.hexdigest()


def _read_kernel_files(root: Path) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    for path in sorted(_iter_modules(str(root))):
        with open(path, "rb") as file:  # noqa: PTH123 - a path of 700
            content = file.read()
        if any(mark in content for mark in _KERNEL_MARKS):
            found[path.removeprefix(str(root))] = content
    return found


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


class _NumbaFinder(importlib.abc.MetaPathFinder):
    # Importing numba takes a third of a second, which most commands do not need, so it is changed when it is imported.

    def __init__(self, loads: dict[str, Callable[[importlib.abc.Loader, ModuleType], None]]) -> None:
        self._loads = loads

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if (load := self._loads.pop(fullname, None)) is None:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _NumbaLoader(spec.loader, load)
        return spec


class _NumbaLoader(importlib.abc.Loader):
    def __init__(self, loader: importlib.abc.Loader, load: Callable[[importlib.abc.Loader, ModuleType], None]) -> None:
        self._loader = loader
        self._load = load

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        self._load(self._loader, module)


def _load_caching(fill: Callable[[], object], loader: importlib.abc.Loader, module: ModuleType) -> None:
    loader.exec_module(module)
    if UNCHECKED_VARIABLE in os.environ:
        _use_our_folders(module)
        module.Cache.save_overload = lambda *_: None
        return
    _sign_files(module)
    fill()
    # The time of last use decides on eviction.
    with contextlib.suppress(OSError):
        os.utime(os.environ[NUMBA_VARIABLE])


# Numba imports scipy.linalg, a fifth of a second, to learn whether it is there; kernels that need it import it again.
def _load_without_scipy(loader: importlib.abc.Loader, module: Any) -> None:
    hidden: dict[str, Any] = {} if _LINEAR_ALGEBRA in sys.modules else {_LINEAR_ALGEBRA: None}
    sys.modules.update(hidden)
    try:
        loader.exec_module(module)
    finally:
        for name in hidden:
            del sys.modules[name]
    if hidden:
        module._HAVE_BLAS = importlib.util.find_spec("scipy") is not None


def _sign_files(caching: Any) -> None:
    if not hasattr(caching.IndexDataCacheFile, "is_signed"):
        caching.IndexDataCacheFile = _build_signed_class(caching.IndexDataCacheFile)
        _use_our_folders(caching)
        _lock_compilations(caching.Cache)


def _use_our_folders(caching: Any) -> None:
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

        # The name of the folder has the hash of our files, wherever and whenever they were installed.
        def get_source_stamp(self) -> Any:
            return "" if _find_package(Path(self._py_file).resolve().parent) else super().get_source_stamp()

        def ensure_cache_path(self) -> None:
            with contextlib.suppress(OSError):
                super().ensure_cache_path()

    return ReadableCacheLocator


# Of several processes that need a kernel one compiles it, and the others load what it has saved.
def _lock_compilations(cache_class: Any) -> None:
    load, save = cache_class.load_overload, cache_class.save_overload

    def load_overload(self: Any, sig: Any, target_context: Any) -> Any:
        if (found := load(self, sig, target_context)) is not None or not _lock_kernel(self):
            return found
        if (found := load(self, sig, target_context)) is not None:
            _unlock_kernel(self)
        return found

    def save_overload(self: Any, sig: Any, data: Any) -> None:
        try:
            save(self, sig, data)
        finally:
            _unlock_kernel(self)

    cache_class.load_overload, cache_class.save_overload = load_overload, save_overload


def _lock_kernel(kernel: Any) -> bool:
    try:
        import fcntl

        _unlock_when_compiling_fails()
        file, place = _open_lock_file(os.getpid()), _get_lock_place(kernel)
        end_s = time.monotonic() + _LOCK_TIMEOUT_S
        while time.monotonic() < end_s:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
            except (BlockingIOError, PermissionError):
                time.sleep(_LOCK_EVERY_S)
            else:
                return True
    except (ImportError, OSError):
        pass  # a system or a disk without such locks: each process compiles for itself
    return False


def _unlock_kernel(kernel: Any) -> None:
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        fcntl.lockf(_open_lock_file(os.getpid()), fcntl.LOCK_UN, 1, _get_lock_place(kernel))


def _get_lock_place(kernel: Any) -> int:
    name = f"{kernel.cache_path}\0{kernel._impl.filename_base}"
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=6).digest(), "little")


# A process has one descriptor: closing any other would release all its locks. A fork may have closed an inherited one.
@cache
def _open_lock_file(_: int) -> int:
    return os.open(Path(os.environ[NUMBA_VARIABLE]) / _LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o600)


@cache
def _unlock_when_compiling_fails() -> None:
    from numba.core import event

    class Unlocking(event.Listener):
        def on_start(self, event: Any) -> None: ...

        def on_end(self, event: Any) -> None:
            dispatcher = event.data["dispatcher"]
            if event.data["args"] not in dispatcher.overloads and hasattr(dispatcher._cache, "_impl"):
                _unlock_kernel(dispatcher._cache)

    event.register("numba:compile", Unlocking())


def _build_signed_class(plain: type[Any]) -> type[Any]:
    import pickle

    class SignedCacheFile(plain):
        """Numba's index and data files with a signature at the end of each, which numba's own class ignores."""

        is_signed = True

        def _load_index(self) -> dict[Any, str]:
            body = read_signed(self._index_path)
            version = pickle.dumps(self._version, protocol=-1)
            if body is None or not body.startswith(version):
                return {}
            stamp, overloads = pickle.loads(body[len(version) :])
            return overloads if stamp == self._source_stamp else {}

        def _save_index(self, overloads: dict[Any, str]) -> None:
            version = pickle.dumps(self._version, protocol=-1)
            write_signed(self._index_path, version + self._dump((self._source_stamp, overloads)))

        def _load_data(self, name: str) -> Any:
            body = read_signed(self._data_path(name))
            if body is None:
                # Numba compiles a missing entry again.
                raise FileNotFoundError(self._data_path(name))
            return pickle.loads(body)

        def _save_data(self, name: str, data: Any) -> None:
            write_signed(self._data_path(name), self._dump(data))

    return SignedCacheFile


def read_signed(path: str) -> bytes | None:
    """Return a file's body without its signature; None if it is absent, or not signed by the key of the cache."""
    if (data := _read_trusted(path)) is None:
        return None
    body, signature = data[:-_SIGNATURE_BYTES], data[-_SIGNATURE_BYTES:]
    return body if is_signed(_name_place(path), body, signature, Path(path)) else None


def write_signed(path: str, body: bytes) -> None:
    """Write a body and its signature.

    Nothing is written without a key, as no process could load it again, nor without write access or above the
    limit on the size of files: the kernel is then compiled again next time.
    """
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
