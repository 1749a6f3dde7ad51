"""Linux's Landlock: a process gives up, for itself and its descendants, all files but those it names.

Without packages of other people, because it runs in the small process between supervisor and agent.
See https://docs.kernel.org/userspace-api/landlock.html for rights and versions.
"""

import ctypes
import os
import struct
import sys
from collections.abc import Iterable

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION_FLAG = 1
_PATH_BENEATH, _NET_PORT = 1, 2
_PR_SET_NO_NEW_PRIVS = 38

EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
MAKE_SOCKET, TRUNCATE, IOCTL_DEV = 1 << 9, 1 << 14, 1 << 15
READ = EXECUTE | READ_FILE | READ_DIR
# Rights that mean something for a file, not only for a folder.
_FILE_ONLY_RIGHTS = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEV
# What each version of Landlock can refuse; the last goes on for later ones.
_FILE_RIGHTS = (0, (1 << 13) - 1, (1 << 14) - 1, (1 << 15) - 1, (1 << 15) - 1, (1 << 16) - 1)
_TCP_SINCE, _SCOPES_SINCE = 4, 6
_CLOSED_SINCE = (
    (3, "files of the user can be cut to nothing"),
    (_TCP_SINCE, "with door: tcp any port can be reached"),
    (_SCOPES_SINCE, "other processes of the user can be signalled, and reached by sockets without a path"),
)
_BIND_AND_CONNECT, _CONNECT = 3, 2
_ABSTRACT_SOCKETS_AND_SIGNALS = 3


def read_version() -> int:
    """Return the version of Landlock that this kernel has, 0 where it has none."""
    if sys.platform != "linux":
        return 0
    return max(0, _syscall(_CREATE_RULESET, None, 0, _VERSION_FLAG))


def list_missing_protections(abi: int) -> list[str]:
    """Return in words what a version of Landlock leaves open that later ones close.

    Args:
        abi: The version, at least 1.
    """
    return [text for since, text in _CLOSED_SINCE if abi < since]


def confine(
    *,
    reads: Iterable[str] = (),
    lists: Iterable[str] = (),
    writes: Iterable[str] = (),
    files_rw: Iterable[str] = (),
    tcp_ports: Iterable[int] = (),
    is_about_files: bool = True,
) -> None:
    """Give up everything but what is named, for this process and all that it will start; what is not there is skipped.

    Args:
        reads: Files and folders to read and execute.
        lists: Folders whose names may be listed, with all below.
        writes: Folders to do anything in, but to make sockets.
        files_rw: Files and devices to read and write.
        tcp_ports: Ports to connect to.
        is_about_files: Whether files are confined at all, or the network alone.

    Raises:
        OSError: the kernel refuses.
    """
    abi = read_version()
    rights = _FILE_RIGHTS[min(abi, len(_FILE_RIGHTS) - 1)] if is_about_files else 0
    network = _BIND_AND_CONNECT if abi >= _TCP_SINCE else 0
    scopes = _ABSTRACT_SOCKETS_AND_SIGNALS if abi >= _SCOPES_SINCE else 0
    attributes = struct.pack("<QQQ", rights, network, scopes)
    if abi < _SCOPES_SINCE:
        attributes = attributes[: 16 if abi >= _TCP_SINCE else 8]
    if not any((rights, network, scopes)):
        return
    ruleset = _check_result(_syscall(_CREATE_RULESET, attributes, len(attributes), 0))
    if is_about_files:
        # Landlock knows no connection to a socket's path, so nobody makes one where another agent could connect.
        for paths, allowed in ((reads, READ), (lists, READ_DIR), (writes, rights & ~MAKE_SOCKET)):
            for path in paths:
                _allow(ruleset, path, allowed & rights)
        for path in files_rw:
            _allow(ruleset, path, (READ_FILE | WRITE_FILE | TRUNCATE | IOCTL_DEV) & rights)
    if network:
        for port in tcp_ports:
            _check_result(_syscall(_ADD_RULE, ruleset, _NET_PORT, struct.pack("<QQ", _CONNECT, port), 0))
    give_up_new_privileges()
    _check_result(_syscall(_RESTRICT_SELF, ruleset, 0))
    os.close(ruleset)


def give_up_new_privileges() -> None:
    """Let no program that this process will start have more rights than itself, as set-user-id programs have."""
    _check_result(ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))


def _allow(ruleset: int, path: str, rights: int) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not os.path.isdir(path):  # noqa: PTH112 - pathlib would double the launcher's start
            rights &= _FILE_ONLY_RIGHTS
        _check_result(_syscall(_ADD_RULE, ruleset, _PATH_BENEATH, struct.pack("<Qi", rights, place), 0))
    finally:
        os.close(place)


def _syscall(number: int, *arguments: object) -> int:
    library = ctypes.CDLL(None, use_errno=True)
    library.syscall.restype = ctypes.c_long
    words = [ctypes.c_long(a) if isinstance(a, int) else a for a in arguments]
    return library.syscall(ctypes.c_long(number), *words)


def _check_result(result: int) -> int:
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, f"Landlock: {os.strerror(code)}")
    return result
