"""The filter of system calls: what it refuses, and what programs need all the same."""

import json
import os
import subprocess
import sys

import pytest

from gslcosim.runtime.processes.sandbox import confinement

# Each line is a call in a process with the filter, and what has to come of it: 0, or the name of an error.
PROGRAM = """
import ctypes, errno, fcntl, json, mmap, os, struct, sys, termios
from gslcosim.runtime.processes.sandbox import confinement

path = sys.argv[1]
library = ctypes.CDLL(None, use_errno=True)
number = json.loads(sys.argv[2])
file = os.open(path, os.O_RDONLY)
pages = mmap.mmap(file, 8192, prot=mmap.PROT_READ, flags=mmap.MAP_PRIVATE)
own = mmap.mmap(-1, 1 << 22, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
anywhere = ctypes.addressof(ctypes.c_char.from_buffer(own))

def call(name, *arguments):
    ctypes.set_errno(0)
    wide = [ctypes.c_long(each) if isinstance(each, int) else each for each in arguments]
    return 0 if library.syscall(number[name], *wide) >= 0 else errno.errorcode[ctypes.get_errno()]

def tried(function, *arguments):
    try:
        function(*arguments)
    except OSError as error:
        return errno.errorcode[error.errno]
    return 0

def advised(memory, advice):
    return tried(memory.madvise, advice)

confinement.filter_calls(allows_unix=True, allows_tcp=False)
room = [bytearray(16)]
print(json.dumps({
    "read with flags of none": tried(os.preadv, file, room, 0, 0),
    "read that does not wait": tried(os.preadv, file, room, 0, os.RWF_NOWAIT),
    "read that is not kept": tried(os.preadv, file, room, 0, 0x80),
    "write at once": tried(os.pwritev, os.open(path, os.O_WRONLY), [b"x"], 0, os.RWF_DSYNC),
    "write that does not wait": tried(os.pwritev, os.open(path, os.O_WRONLY), [b"x"], 0, os.RWF_NOWAIT),
    "forget a file": tried(os.posix_fadvise, file, 0, 0, os.POSIX_FADV_DONTNEED),
    "fetch a file": call("readahead", file, 0, 4096),
    "cold": advised(pages, 20),
    "page out": advised(pages, 21),
    "will need": advised(pages, mmap.MADV_WILLNEED),
    "sequential": advised(pages, mmap.MADV_SEQUENTIAL),
    "do not need": advised(own, mmap.MADV_DONTNEED),
    "free": advised(own, mmap.MADV_FREE),
    "populate": advised(own, 22),
    "which pages": call("mincore", anywhere, 4096, ctypes.create_string_buffer(1)),
    "how many pages": call("cachestat", file, struct.pack("QQ", 0, 4096), ctypes.create_string_buffer(40), 0),
    "advice to a process": call("process_madvise", 0, 0, 0, 21, 0),
    "asynchronous reads": call("io_setup", 1, ctypes.create_string_buffer(8)),
    "read flags of a descriptor": tried(fcntl.fcntl, file, fcntl.F_GETFL),
    "set flags of a descriptor": tried(fcntl.fcntl, file, fcntl.F_SETFL, os.O_NONBLOCK),
    "hint on a file": tried(fcntl.fcntl, file, 1036, struct.pack("Q", 3)),
    "bytes that wait": tried(fcntl.ioctl, os.pipe()[0], termios.FIONREAD, bytes(4)),
    "flags on a file": tried(fcntl.ioctl, file, 0x40086602, bytes(8)),
    "version of a file": tried(fcntl.ioctl, file, 0x40087602, bytes(8)),
}))
"""
NUMBERS = {
    "x86_64": {"readahead": 187, "mincore": 27, "cachestat": 451, "process_madvise": 440, "io_setup": 206},
    "aarch64": {"readahead": 213, "mincore": 232, "cachestat": 451, "process_madvise": 440, "io_setup": 0},
}
EXPECTED = {
    "read with flags of none": 0, "read that does not wait": "ENOTSUP", "read that is not kept": "ENOTSUP",
    "write at once": 0, "write that does not wait": "ENOTSUP", "forget a file": 0, "fetch a file": 0, "cold": 0,
    "page out": 0, "will need": 0, "sequential": 0, "do not need": 0, "free": 0, "populate": 0,
    "which pages": "ENOSYS", "how many pages": "ENOSYS", "advice to a process": "EPERM", "asynchronous reads": "EPERM",
    "read flags of a descriptor": 0, "set flags of a descriptor": 0, "hint on a file": "EPERM", "bytes that wait": 0,
    "flags on a file": "EPERM", "version of a file": "EPERM",
}  # fmt: skip


@pytest.mark.skipif(not confinement.can_filter(), reason="there is no filter for this system or processor")
def test_programs_keep_what_they_need_and_leave_nothing_behind(tmp_path):
    """Advice that would be seen by others succeeds and does nothing; a process that asks finds no such call."""
    path = tmp_path / "file"
    path.write_bytes(bytes(8192))
    words = [sys.executable, "-c", PROGRAM, str(path), json.dumps(NUMBERS[os.uname().machine])]
    tried = subprocess.run(words, capture_output=True, text=True, check=True)
    found = json.loads(tried.stdout)
    # Kernels before 5.14 cannot populate.
    found["populate"] = 0 if found["populate"] == "EINVAL" else found["populate"]
    assert found == EXPECTED


@pytest.mark.parametrize("machine", NUMBERS)
@pytest.mark.parametrize("is_beside_namespaces", [True, False])
def test_each_jump_of_the_filter_ends_within_it(machine, is_beside_namespaces):
    """The kernel takes no other, and no jump is farther than 255."""
    for tcp in (True, False):
        code = confinement.build_filter_program(
            machine, allows_unix=True, allows_tcp=tcp, is_beside_namespaces=is_beside_namespaces
        )
        n = len(code) // 8
        for at in range(n):
            kind, if_true, if_false = code[8 * at], code[8 * at + 2], code[8 * at + 3]
            assert kind != 0x15 or at + 1 + max(if_true, if_false) < n
