"""Confinement of a process by Linux: Landlock for files, a filter of system calls, dropped capabilities.

A process gives up, for itself and its descendants, all files but those it names, and all of root's capabilities. The
module imports no third-party package, because it runs in the small process between supervisor and agent. See
https://docs.kernel.org/userspace-api/landlock.html for rights and versions, and `man 7 capabilities`.

The filter refuses calls that Landlock cannot refuse: sockets of the network, communication between processes other
than by files, changes to objects of others, and traces that outlive a process, such as the kernel's cached pages of
files. Refused calls return EPERM; advice is accepted and not followed. Written for x86_64 and arm64; elsewhere there is
no filter, and `can_filter` returns False. The instructions are those of classic BPF, see `man 2 seccomp`.
"""

import ctypes
import errno
import os
import struct
import sys
from collections.abc import Iterable
from typing import NamedTuple

# Descriptors that a shell can name by one digit, above its standard ones.
PIPES_AT = (8, 9)


_PR_CAPBSET_DROP, _PR_SET_SECUREBITS = 24, 28
# Neither user 0 nor a change of user brings capabilities, and these settings are locked.
_SECURE_BITS = 0b1110_1111
_VERSION = 0x20080522
_MAX_CAPABILITIES = 64
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION_FLAG = 1
_PATH_BENEATH, _NET_PORT = 1, 2
_PR_SET_NO_NEW_PRIVS = 38
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
MAKE_SOCKET, TRUNCATE, IOCTL_DEV = 1 << 9, 1 << 14, 1 << 15
READ = EXECUTE | READ_FILE | READ_DIR
# Rights that apply to files, not only to folders.
_FILE_ONLY_RIGHTS = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEV
# Rights that each version of Landlock can refuse; the last entry holds for later versions too.
_FILE_RIGHTS = (0, (1 << 13) - 1, (1 << 14) - 1, (1 << 15) - 1, (1 << 15) - 1, (1 << 16) - 1)
_TCP_SINCE, _SCOPES_SINCE = 4, 6
_CLOSED_SINCE = (
    (3, "files of the user can be cut to nothing"),
    (_TCP_SINCE, "with door: tcp any port can be reached"),
    (_SCOPES_SINCE, "other processes of the user can be signalled, and reached by sockets without a path"),
)
_BIND_AND_CONNECT, _CONNECT = 3, 2
_ABSTRACT_SOCKETS_AND_SIGNALS = 3
_PR_SET_SECCOMP, _MODE_FILTER = 22, 2
_LOAD, _EQUAL, _AT_LEAST, _HAS_ANY_BIT, _AND, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x54, 0x06
_ALLOW, _FAIL = 0x7FFF0000, 0x00050000
_REFUSE, _PASS_OVER, _LACK = _FAIL | errno.EPERM, _FAIL, _FAIL | errno.ENOSYS
# Where the filter finds the number, the architecture, and the lower halves of four of the six arguments.
_NUMBER, _ARCHITECTURE, _FIRST, _SECOND, _THIRD, _SIXTH = 0, 4, 16, 24, 32, 56
_UNIX, _INTERNET, _NETLINK, _INTERNET_6 = 1, 2, 16, 10
_STREAM, _KIND_OF_SOCKET, _TCP = 1, 0xF, 6
_X32 = 0x40000000
# Commands of fcntl that inform a process of others' use of a file (leases, changes in a folder), or that
# leave a hint on it that others can read (F_SET_RW_HINT, F_SET_FILE_RW_HINT).
_FCNTL_COMMANDS = (1024, 1026, 1036, 1038)
# Commands of ioctl that leave traces on a file open for reading, with no check but that of ownership:
# FS_IOC_SETFLAGS, FS_IOC_SETVERSION and EXT4_IOC_SETVERSION, those of 32 bits, FS_IOC_FSSETXATTR,
# FS_IOC_ENABLE_VERITY, FS_IOC_ADD_ENCRYPTION_KEY; and EXT4_IOC_CLEAR_ES_CACHE, EXT4_IOC_PRECACHE_EXTENTS.
_IOCTL_COMMANDS = (
    0x40086602, 0x40087602, 0x40086604, 0x40046602, 0x40047602, 0x401C5820, 0x40806685, 0xC0506617, 0x6628, 0x6612,
)  # fmt: skip
# MADV_COLD, MADV_PAGEOUT.
_EVICTING_ADVICE = (20, 21)
# RWF_NOWAIT, with which a read reveals whether it would have to wait for the disk, and RWF_DONTCACHE.
_CACHE_FLAGS = 0x08 | 0x80


def give_up_capabilities() -> None:
    """Give up all capabilities; without effect in a process that has none."""
    library = ctypes.CDLL(None, use_errno=True)
    # These two calls need capabilities, and matter only in a process that has them.
    library.prctl(_PR_SET_SECUREBITS, _SECURE_BITS, 0, 0, 0)
    for capability in range(_MAX_CAPABILITIES):
        library.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)
    _check_result(library.capset(struct.pack("<Ii", _VERSION, 0), bytes(24)), "capabilities")


def read_landlock_version() -> int:
    """Return the version of Landlock in this kernel, 0 if there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, _syscall(_CREATE_RULESET, None, 0, _VERSION_FLAG))


def list_missing_protections(abi: int) -> list[str]:
    """Return in words the gaps that a version of Landlock leaves and later ones close."""
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
    """Give up all but the named paths, for this process and its later children; paths that do not exist are skipped.

    Args:
        reads: Files and folders to read and execute.
        lists: Folders whose names may be listed, with all below.
        writes: Folders to do anything in, but to make sockets.
        files_rw: Files and devices to read and write.
        is_about_files: Whether files are confined at all, or the network alone.
    """
    abi = read_landlock_version()
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
        # Landlock cannot refuse connections to a socket's path, so no socket may be made in reach of another agent.
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
    """Deny later children of this process more rights than its own, as set-user-id programs would have."""
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


def _check_result(result: int, what: str = "Landlock") -> int:
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, f"{what}: {os.strerror(code)}")
    return result


class _Numbers(NamedTuple):
    # The numbers of system calls of one kind of machine.
    architecture: int
    socket: int
    fcntl: int
    ioctl: int
    madvise: int
    # Read and write with flags.
    with_flags: tuple[int, ...]
    # Refused in each sandbox.
    always: tuple[int, ...]
    # Advice on which pages of files stay in memory, which all processes share.
    advice: tuple[int, ...]
    # Queries of the pages of files that are in memory.
    residency: tuple[int, ...]
    # Memory, queues and semaphores that last beyond their processes: bubblewrap has a namespace of them.
    shared: tuple[int, ...]
    # Changes to objects of others.
    of_others: tuple[int, ...]
    # Calls that may only concern the caller itself (0).
    only_self: tuple[int, ...]


_CALL_NUMBERS = {
    "x86_64": _Numbers(
        architecture=0xC000003E,
        socket=41,
        fcntl=72,
        ioctl=16,
        madvise=28,
        # preadv2, pwritev2
        with_flags=(327, 328),
        # add_key, request_key, keyctl, perf_event_open, bpf, io_uring_setup, syslog, open_by_handle_at
        # inotify_init, inotify_init1, inotify_add_watch, fanotify_init, fanotify_mark
        # io_setup, process_madvise, quotactl, quotactl_fd, userfaultfd
        always=(248, 249, 250, 298, 321, 425, 103, 304, 253, 294, 254, 300, 301, 206, 440, 179, 443, 323),
        # fadvise64, readahead
        advice=(221, 187),
        # mincore, cachestat
        residency=(27, 451),
        # shmget, shmat, shmctl, semget, semop, semctl, semtimedop, msgget, msgsnd, msgrcv, msgctl, mq_open, mq_unlink
        shared=(29, 30, 31, 64, 65, 66, 220, 68, 69, 70, 71, 240, 241),
        # chmod, fchmod, chown, fchown, lchown, setxattr, lsetxattr, fsetxattr, removexattr, lremovexattr,
        # fremovexattr, fchownat, fchmodat, fchmodat2, setxattrat, removexattrat, setpriority, ioprio_set
        # utime, utimes, futimesat, utimensat, file_setattr
        of_others=(
            90, 91, 92, 93, 94, 188, 189, 190, 197, 198, 199, 260, 268, 452, 463, 466, 141, 251,
            132, 235, 261, 280, 469,
        ),
        # sched_setparam, sched_setscheduler, sched_setaffinity, prlimit64, sched_setattr
        only_self=(142, 144, 203, 302, 314),
    ),
    "aarch64": _Numbers(
        architecture=0xC00000B7,
        socket=198,
        fcntl=25,
        ioctl=29,
        madvise=233,
        # preadv2, pwritev2
        with_flags=(286, 287),
        # add_key, request_key, keyctl, perf_event_open, bpf, io_uring_setup, syslog, open_by_handle_at
        # inotify_init1, inotify_add_watch, fanotify_init, fanotify_mark
        # io_setup, process_madvise, quotactl, quotactl_fd, userfaultfd
        always=(217, 218, 219, 241, 280, 425, 116, 265, 26, 27, 262, 263, 0, 440, 60, 443, 282),
        # fadvise64, readahead
        advice=(223, 213),
        # mincore, cachestat
        residency=(232, 451),
        # shmget, shmctl, shmat, semget, semctl, semtimedop, semop, msgget, msgctl, msgrcv, msgsnd, mq_open, mq_unlink
        shared=(194, 195, 196, 190, 191, 192, 193, 186, 187, 188, 189, 180, 181),
        # setxattr, lsetxattr, fsetxattr, removexattr, lremovexattr, fremovexattr, fchmod, fchmodat, fchownat, fchown,
        # fchmodat2, setxattrat, removexattrat, setpriority, ioprio_set, utimensat, file_setattr
        of_others=(5, 6, 7, 14, 15, 16, 52, 53, 54, 55, 452, 463, 466, 140, 30, 88, 469),
        # sched_setparam, sched_setscheduler, sched_setaffinity, prlimit64, sched_setattr
        only_self=(118, 119, 122, 261, 274),
    ),
}  # fmt: skip


def can_filter() -> bool:
    """Return whether there is a filter for this machine."""
    return sys.platform == "linux" and os.uname().machine in _CALL_NUMBERS


def filter_calls(*, allows_unix: bool, allows_tcp: bool) -> None:
    """Refuse calls beyond Landlock, for this process and its later children; see `build_filter_program`."""
    if not can_filter():
        return
    code = build_filter_program(
        os.uname().machine, allows_unix=allows_unix, allows_tcp=allows_tcp, is_beside_namespaces=False
    )
    give_up_new_privileges()
    instructions = ctypes.create_string_buffer(code, len(code))
    described = struct.pack("<HxxxxxxQ", len(code) // 8, ctypes.addressof(instructions))
    library = ctypes.CDLL(None, use_errno=True)
    _check_result(library.prctl(_PR_SET_SECCOMP, _MODE_FILTER, described, 0, 0), "seccomp")


def build_filter_program(
    machine: str,
    *,
    allows_unix: bool,
    allows_tcp: bool,
    is_beside_namespaces: bool,
    has_own_network: bool = False,
    owns_devices: bool = False,
) -> bytes:
    """Return the instructions of the filter.

    Always refused are keys of the user, observation of others by perf, inotify, fanotify and leases, programs in the
    kernel, the kernel's log, files by their handles, quotas, marks on files, and the kernel's own queues of reads and
    writes, which bypass a filter. No call evicts pages of files or queries which are in memory: advice is accepted and
    not followed, and the queries do not exist, as on older kernels. Programs for another machine architecture do not
    run.

    Args:
        is_beside_namespaces: Whether namespaces keep files, processes and System V's memory apart already; otherwise
            that memory, queues, semaphores, and changes of rights, owners, times and of other processes are refused.
        has_own_network: Whether the process has a network namespace of its own, whose internet sockets reach nothing.
        owns_devices: Whether the user is root, the owner of the machine's devices: changes of rights, owners and
            times are refused beside namespaces too, since a mount cannot keep a device both usable and unchanged.
    """
    numbers = _CALL_NUMBERS[machine]
    # Each instruction is its code, its value, and the numbers of instructions to skip if true, and if false.
    refuse, allow = (_RETURN, _REFUSE, 0, 0), (_RETURN, _ALLOW, 0, 0)
    code = [(_LOAD, _ARCHITECTURE, 0, 0), (_EQUAL, numbers.architecture, 1, 0), refuse]
    code += [(_LOAD, _NUMBER, 0, 0), (_AT_LEAST, _X32, 0, 1), refuse]
    of_others = () if is_beside_namespaces and not owns_devices else numbers.of_others
    of_others += () if is_beside_namespaces else numbers.shared
    for calls, answer in (
        ((*numbers.always, *of_others), _REFUSE),
        (numbers.advice, _PASS_OVER),
        (numbers.residency, _LACK),
    ):
        for number in calls:
            code += [(_EQUAL, number, 0, 1), (_RETURN, answer, 0, 0)]
    no_such_flag = _FAIL | errno.EOPNOTSUPP
    for number, argument, test, values, answer in (
        (numbers.fcntl, _SECOND, _EQUAL, _FCNTL_COMMANDS, _REFUSE),
        (numbers.ioctl, _SECOND, _EQUAL, _IOCTL_COMMANDS, _REFUSE),
        (numbers.madvise, _THIRD, _EQUAL, _EVICTING_ADVICE, _PASS_OVER),
        *((number, _SIXTH, _HAS_ANY_BIT, (_CACHE_FLAGS,), no_such_flag) for number in numbers.with_flags),
    ):
        # Any other call skips the following checks.
        code += [(_EQUAL, number, 0, 2 + 2 * len(values)), (_LOAD, argument, 0, 0)]
        for value in values:
            code += [(test, value, 0, 1), (_RETURN, answer, 0, 0)]
        code += [allow]
    for number in () if is_beside_namespaces else numbers.only_self:
        code += [(_EQUAL, number, 0, 4), (_LOAD, _FIRST, 0, 0), (_EQUAL, 0, 1, 0), refuse, allow]
    code += [(_EQUAL, numbers.socket, 1, 0), allow, (_LOAD, _FIRST, 0, 0)]
    families = [_UNIX] if allows_unix else []
    if has_own_network:
        # Without families that reach beyond a network namespace, such as vsock from a virtual machine to its host.
        families += [_INTERNET, _INTERNET_6, _NETLINK]
    for family in families:
        code += [(_EQUAL, family, 0, 1), allow]
    if allows_tcp:
        # A failed comparison jumps to the last instruction of all. Landlock can restrict TCP, but no other stream.
        code += [(_EQUAL, _INTERNET, 1, 0), (_EQUAL, _INTERNET_6, 0, 7)]
        code += [(_LOAD, _SECOND, 0, 0), (_AND, _KIND_OF_SOCKET, 0, 0), (_EQUAL, _STREAM, 0, 4)]
        code += [(_LOAD, _THIRD, 0, 0), (_EQUAL, 0, 1, 0), (_EQUAL, _TCP, 0, 1), allow]
    code += [refuse]
    return b"".join(struct.pack("<HBBI", kind, if_true, if_false, value) for kind, value, if_true, if_false in code)
