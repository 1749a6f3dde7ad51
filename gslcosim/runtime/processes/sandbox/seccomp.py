"""Filter of system calls for what Landlock cannot refuse: sockets of the network, and changes of files of others.

These are sockets of the network, ways past files from one process to another, and changes of what belongs to others.
Calls that are refused return EPERM. Written for x86_64 and arm64; elsewhere there is no filter, and `is_possible` says
so. The instructions are those of classic BPF, see `man 2 seccomp`.
"""

import ctypes
import errno
import os
import struct
import sys

from gslcosim.runtime.processes.sandbox.landlock import give_up_new_privileges

_PR_SET_SECCOMP, _MODE_FILTER = 22, 2
_LOAD, _EQUAL, _AT_LEAST, _AND, _RETURN = 0x20, 0x15, 0x35, 0x54, 0x06
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | errno.EPERM
# Where the filter finds the number, the architecture, and the lower halves of the first three arguments.
_NUMBER, _ARCHITECTURE, _FIRST, _SECOND, _THIRD = 0, 4, 16, 24, 32
_UNIX, _INTERNET, _NETLINK, _INTERNET_6 = 1, 2, 16, 10
_STREAM, _KIND_OF_SOCKET, _TCP = 1, 0xF, 6
_X32 = 0x40000000
# Commands of fcntl by which a process is informed of what others do with a file: leases, and changes in a folder.
_WATCHING_COMMANDS = (1024, 1026)


class _Numbers:
    # The numbers of system calls of one kind of machine.

    def __init__(
        self,
        *,
        architecture: int,
        socket: int,
        fcntl: int,
        always: tuple[int, ...],
        shared: tuple[int, ...],
        of_others: tuple[int, ...],
        only_self: tuple[int, ...],
    ) -> None:
        self.architecture = architecture
        self.socket = socket
        self.fcntl = fcntl
        # Refused in each sandbox.
        self.always = always
        # Memory, queues and semaphores that last beyond their processes: bubblewrap has a namespace of them.
        self.shared = shared
        # Changes of what belongs to others.
        self.of_others = of_others
        # May only be about the caller itself (0).
        self.only_self = only_self


_CALL_NUMBERS = {
    "x86_64": _Numbers(
        architecture=0xC000003E,
        socket=41,
        fcntl=72,
        # add_key, request_key, keyctl, perf_event_open, bpf, io_uring_setup, syslog, open_by_handle_at
        # inotify_init, inotify_init1, inotify_add_watch, fanotify_init, fanotify_mark
        always=(248, 249, 250, 298, 321, 425, 103, 304, 253, 294, 254, 300, 301),
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
        # add_key, request_key, keyctl, perf_event_open, bpf, io_uring_setup, syslog, open_by_handle_at
        # inotify_init1, inotify_add_watch, fanotify_init, fanotify_mark
        always=(217, 218, 219, 241, 280, 425, 116, 265, 26, 27, 262, 263),
        # shmget, shmctl, shmat, semget, semctl, semtimedop, semop, msgget, msgctl, msgrcv, msgsnd, mq_open, mq_unlink
        shared=(194, 195, 196, 190, 191, 192, 193, 186, 187, 188, 189, 180, 181),
        # setxattr, lsetxattr, fsetxattr, removexattr, lremovexattr, fremovexattr, fchmod, fchmodat, fchownat, fchown,
        # fchmodat2, setxattrat, removexattrat, setpriority, ioprio_set, utimensat, file_setattr
        of_others=(5, 6, 7, 14, 15, 16, 52, 53, 54, 55, 452, 463, 466, 140, 30, 88, 469),
        # sched_setparam, sched_setscheduler, sched_setaffinity, prlimit64, sched_setattr
        only_self=(118, 119, 122, 261, 274),
    ),
}  # fmt: skip


def is_possible() -> bool:
    """Return whether there is a filter for this machine."""
    return sys.platform == "linux" and os.uname().machine in _CALL_NUMBERS


def filter_calls(*, allows_unix: bool, allows_tcp: bool) -> None:
    """Refuse what Landlock does not know, for this process and all that it will start; see `build_program`.

    Args:
        allows_unix: Whether unix sockets are allowed.
        allows_tcp: Whether TCP is.

    Raises:
        OSError: the kernel refuses.
    """
    if not is_possible():
        return
    code = build_program(os.uname().machine, allows_unix=allows_unix, allows_tcp=allows_tcp, is_beside_namespaces=False)
    give_up_new_privileges()
    instructions = ctypes.create_string_buffer(code, len(code))
    described = struct.pack("<HxxxxxxQ", len(code) // 8, ctypes.addressof(instructions))
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_SECCOMP, _MODE_FILTER, described, 0, 0) < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"seccomp: {os.strerror(number)}")


def build_program(
    machine: str, *, allows_unix: bool, allows_tcp: bool, is_beside_namespaces: bool, has_own_network: bool = False
) -> bytes:
    """Return the instructions of the filter.

    Always refused are keys of the user, watching others by perf, by inotify, fanotify and leases, programs in the
    kernel, the kernel's log, files by their handles, and io_uring, by which a filter can be passed by; programs for
    another kind of machine do not run.

    Args:
        machine: The kind of processor.
        allows_unix: Whether unix sockets are allowed.
        allows_tcp: Whether TCP is.
        is_beside_namespaces: Whether namespaces keep files, processes and System V's memory apart already; otherwise
            that memory, queues, semaphores, and changes of rights, owners, times and of other processes are refused.
        has_own_network: Whether the network is a namespace of its own, in which internet sockets reach nobody.
    """
    numbers = _CALL_NUMBERS[machine]
    code = [
        _pack_instruction(_LOAD, _ARCHITECTURE),
        _pack_instruction(_EQUAL, numbers.architecture, 1, 0),
        _pack_instruction(_RETURN, _REFUSE),
        _pack_instruction(_LOAD, _NUMBER),
        _pack_instruction(_AT_LEAST, _X32, 0, 1),
        _pack_instruction(_RETURN, _REFUSE),
    ]
    for number in (*numbers.always, *(() if is_beside_namespaces else (*numbers.shared, *numbers.of_others))):
        code += [_pack_instruction(_EQUAL, number, 0, 1), _pack_instruction(_RETURN, _REFUSE)]
    # Not this one: over the next ones.
    code += [
        _pack_instruction(_EQUAL, numbers.fcntl, 0, 2 + 2 * len(_WATCHING_COMMANDS)),
        _pack_instruction(_LOAD, _SECOND),
    ]
    for command in _WATCHING_COMMANDS:
        code += [_pack_instruction(_EQUAL, command, 0, 1), _pack_instruction(_RETURN, _REFUSE)]
    code += [_pack_instruction(_RETURN, _ALLOW)]
    for number in () if is_beside_namespaces else numbers.only_self:
        code += [
            _pack_instruction(_EQUAL, number, 0, 4),
            _pack_instruction(_LOAD, _FIRST),
            _pack_instruction(_EQUAL, 0, 1, 0),
        ]
        code += [_pack_instruction(_RETURN, _REFUSE), _pack_instruction(_RETURN, _ALLOW)]
    code += [
        _pack_instruction(_EQUAL, numbers.socket, 1, 0),
        _pack_instruction(_RETURN, _ALLOW),
        _pack_instruction(_LOAD, _FIRST),
    ]
    families = [_UNIX] if allows_unix else []
    if has_own_network:
        # There are none in which others could be reached, as those to the machine that runs a virtual one.
        families += [_INTERNET, _INTERNET_6, _NETLINK]
    for family in families:
        code += [_pack_instruction(_EQUAL, family, 0, 1), _pack_instruction(_RETURN, _ALLOW)]
    if allows_tcp:
        # Each jump that fails ends at the last instruction of all. Landlock knows TCP, but no other kind of stream.
        code += [_pack_instruction(_EQUAL, _INTERNET, 1, 0), _pack_instruction(_EQUAL, _INTERNET_6, 0, 7)]
        code += [
            _pack_instruction(_LOAD, _SECOND),
            _pack_instruction(_AND, _KIND_OF_SOCKET),
            _pack_instruction(_EQUAL, _STREAM, 0, 4),
        ]
        code += [
            _pack_instruction(_LOAD, _THIRD),
            _pack_instruction(_EQUAL, 0, 1, 0),
            _pack_instruction(_EQUAL, _TCP, 0, 1),
            _pack_instruction(_RETURN, _ALLOW),
        ]
    code += [_pack_instruction(_RETURN, _REFUSE)]
    return b"".join(code)


def _pack_instruction(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    return struct.pack("<HBBI", code, if_true, if_false, value)
