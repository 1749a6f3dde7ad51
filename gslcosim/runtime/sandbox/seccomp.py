"""A filter of system calls for what Landlock cannot refuse: sockets of the network, and changes of what is not theirs.

Calls that are refused return EPERM. Written for x86_64 and arm64; elsewhere there is no filter, and `is_possible` says
so. The instructions are those of classic BPF, see `man 2 seccomp`.
"""

import ctypes
import errno
import os
import struct
import sys

from gslcosim.runtime.sandbox.landlock import give_up_new_privileges

_PR_SET_SECCOMP, _MODE_FILTER = 22, 2
_LOAD, _EQUAL, _AT_LEAST, _AND, _RETURN = 0x20, 0x15, 0x35, 0x54, 0x06
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | errno.EPERM
# Where the filter finds the number, the architecture, and the lower halves of the first three arguments.
_NUMBER, _ARCHITECTURE, _FIRST, _SECOND, _THIRD = 0, 4, 16, 24, 32
_UNIX, _INTERNET, _NETLINK, _INTERNET_6 = 1, 2, 16, 10
_STREAM, _KIND_OF_SOCKET, _TCP = 1, 0xF, 6
_X32 = 0x40000000

# By machine: its number, `socket`, calls that are always refused, those that change what belongs to others, and calls
# that may only be about the caller itself (0).
_MACHINES: dict[str, tuple[int, int, tuple[int, ...], tuple[int, ...], tuple[int, ...]]] = {
    "x86_64": (
        0xC000003E,
        41,
        # add_key, request_key, keyctl, perf_event_open, bpf, io_uring_setup
        (248, 249, 250, 298, 321, 425),
        # chmod, fchmod, chown, fchown, lchown, setxattr, lsetxattr, fsetxattr, removexattr, lremovexattr,
        # fremovexattr, fchownat, fchmodat, fchmodat2, setxattrat, removexattrat, setpriority, ioprio_set
        (90, 91, 92, 93, 94, 188, 189, 190, 197, 198, 199, 260, 268, 452, 463, 466, 141, 251),
        # sched_setparam, sched_setscheduler, sched_setaffinity, prlimit64, sched_setattr
        (142, 144, 203, 302, 314),
    ),
    "aarch64": (
        0xC00000B7,
        198,
        # add_key, request_key, keyctl, perf_event_open, bpf, io_uring_setup
        (217, 218, 219, 241, 280, 425),
        # setxattr, lsetxattr, fsetxattr, removexattr, lremovexattr, fremovexattr, fchmod, fchmodat, fchownat, fchown,
        # fchmodat2, setxattrat, removexattrat, setpriority, ioprio_set
        (5, 6, 7, 14, 15, 16, 52, 53, 54, 55, 452, 463, 466, 140, 30),
        # sched_setparam, sched_setscheduler, sched_setaffinity, prlimit64, sched_setattr
        (118, 119, 122, 261, 274),
    ),
}


def is_possible() -> bool:
    """Return whether there is a filter for this machine."""
    return sys.platform == "linux" and os.uname().machine in _MACHINES


def filter_calls(*, allows_unix: bool, allows_tcp: bool, is_about_files: bool) -> None:
    """Refuse sockets but of the kinds that are named, for this process and all that it will start.

    Keys of the user, watching others by perf, programs in the kernel and io_uring, by which a filter can be passed by,
    are always refused, and programs for another kind of machine do not run.

    Args:
        allows_unix: Whether unix sockets are allowed.
        allows_tcp: Whether TCP is.
        is_about_files: Whether changing the rights and owners of files, and the limits and scheduling of other
            processes, is refused as well.

    Raises:
        OSError: the kernel refuses.
    """
    if not is_possible():
        return
    code = program(os.uname().machine, allows_unix=allows_unix, allows_tcp=allows_tcp, is_about_files=is_about_files)
    give_up_new_privileges()
    instructions = ctypes.create_string_buffer(code, len(code))
    described = struct.pack("<HxxxxxxQ", len(code) // 8, ctypes.addressof(instructions))
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_SECCOMP, _MODE_FILTER, described, 0, 0) < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"seccomp: {os.strerror(number)}")


def program(
    machine: str, *, allows_unix: bool, allows_tcp: bool, is_about_files: bool, is_about_sockets: bool = True
) -> bytes:
    """Return the instructions of the filter; see `filter_calls`.

    Args:
        machine: The kind of processor.
        allows_unix: As there.
        allows_tcp: As there.
        is_about_files: As there.
        is_about_sockets: Whether sockets are refused at all.
    """
    architecture, socket, always, refused, only_self = _MACHINES[machine]
    code = [
        _step(_LOAD, _ARCHITECTURE),
        _step(_EQUAL, architecture, 1, 0),
        _step(_RETURN, _REFUSE),
        _step(_LOAD, _NUMBER),
        _step(_AT_LEAST, _X32, 0, 1),
        _step(_RETURN, _REFUSE),
    ]
    for number in (*always, *(refused if is_about_files else ())):
        code += [_step(_EQUAL, number, 0, 1), _step(_RETURN, _REFUSE)]
    if is_about_files:
        for number in only_self:
            # Not this one: over the next five.
            code += [_step(_EQUAL, number, 0, 4), _step(_LOAD, _FIRST), _step(_EQUAL, 0, 1, 0)]
            code += [_step(_RETURN, _REFUSE), _step(_RETURN, _ALLOW)]
    if not is_about_sockets:
        return b"".join([*code, _step(_RETURN, _ALLOW)])
    code += [_step(_EQUAL, socket, 1, 0), _step(_RETURN, _ALLOW), _step(_LOAD, _FIRST)]
    for family in (_NETLINK, *((_UNIX,) if allows_unix else ())):
        code += [_step(_EQUAL, family, 0, 1), _step(_RETURN, _ALLOW)]
    if allows_tcp:
        # Each jump that fails ends at the last instruction of all. Landlock knows TCP, but no other kind of stream.
        code += [_step(_EQUAL, _INTERNET, 1, 0), _step(_EQUAL, _INTERNET_6, 0, 7)]
        code += [_step(_LOAD, _SECOND), _step(_AND, _KIND_OF_SOCKET), _step(_EQUAL, _STREAM, 0, 4)]
        code += [_step(_LOAD, _THIRD), _step(_EQUAL, 0, 1, 0), _step(_EQUAL, _TCP, 0, 1), _step(_RETURN, _ALLOW)]
    code += [_step(_RETURN, _REFUSE)]
    return b"".join(code)


def _step(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    return struct.pack("<HBBI", code, if_true, if_false, value)
