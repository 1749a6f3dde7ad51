"""An agent that tries everything to learn what it must not know or to harm others, and logs what it has reached.

Its argument is JSON: what the test has laid out for it. Each attack returns evidence that it got through, or nothing.
"""

import contextlib
import ctypes
import json
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from raw import RawAgent

TARGETS = json.loads(sys.argv[1])
RUNS, OUTSIDE, VICTIM = Path(TARGETS["runs"]), Path(TARGETS["outside"]), TARGETS["victim"]
# Its own processes would write what the loader reports among what they print.
os.environ.pop("LD_DEBUG", None)
LIBRARY = ctypes.CDLL(None, use_errno=True)
CLONE_NEWUSER, CLONE_NEWNS, PTRACE_SEIZE = 0x10000000, 0x20000, 0x4206
# Numbers of system calls on every kind of machine, then by kind of machine.
PIDFD_OPEN, PIDFD_GETFD, PROCESS_MADVISE, CACHESTAT = 434, 438, 440, 451
IO_SETUP = 0 if os.uname().machine == "aarch64" else 206
KEYCTL, PERF_EVENT_OPEN, SYSLOG = (219, 241, 116) if os.uname().machine == "aarch64" else (250, 298, 103)
SEARCH, READ, USER_KEYRING = 10, 11, -4
SHARED_BYTES = 160 << 20
# More than a private folder of bubblewrap holds.
FILLED_BYTES = 300 << 20


def _text_of(*paths):
    for path in paths:
        with contextlib.suppress(OSError):
            if found := Path(path).read_bytes():
                return repr(found[:40])
    return ""


def read_scenario_file():
    return _text_of(TARGETS["scenario"], Path(TARGETS["scenario"]).name)


def read_bundled_scenario():
    return _text_of(TARGETS["bundled"])


def read_run_folder():
    names = ("scenario.yaml", "setup.json", "manifest.json")
    folders = [RUNS, *map(Path, TARGETS["runs_of_others"])]
    return _text_of(*(path for name in names for folder in folders for path in folder.glob(f"*/{name}")))


def read_run_folder_by_its_name():
    run = Path(TARGETS["runs"]) / agent.join.namespace.removeprefix("gsl/")
    return _text_of(run / "scenario.yaml", run / "setup.json", run / "inputs.log", run / "logs" / "world.log")


def read_through_proc():
    roots = [f"/proc/{pid}/{link}" for pid in ("self", "1", VICTIM, os.getppid()) for link in ("root", "cwd")]
    return _text_of(*(f"{root}{TARGETS['scenario']}" for root in roots), *(f"{root}/room.yaml" for root in roots))


def read_cache_of_environments():
    with contextlib.suppress(OSError):
        return str(list(Path(TARGETS["cache"], "environments").iterdir())[:1])
    return ""


def read_environment_of_others():
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if TARGETS["secret"].encode() in path.read_bytes():
                return str(path)
    return ""


def read_command_lines_of_others():
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            # Backwards in this process's own.
            if TARGETS["tnemugra"][::-1].encode() in path.read_bytes():
                return str(path)
    return ""


def read_memory_of_others():
    with contextlib.suppress(OSError):
        place = int(Path(f"/proc/{VICTIM}/maps").read_text().split("-")[0], 16)
        with Path(f"/proc/{VICTIM}/mem").open("rb") as memory:
            memory.seek(place)
            return repr(memory.read(8))
    return ""


def trace_others():
    LIBRARY.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
    return "attached" if LIBRARY.ptrace(PTRACE_SEIZE, VICTIM, None, None) == 0 else ""


def end_others():
    with contextlib.suppress(OSError):
        os.kill(VICTIM, signal.SIGUSR1)
        return "signalled"
    return ""


def limit_others():
    with contextlib.suppress(OSError):
        resource.prlimit(VICTIM, resource.RLIMIT_NOFILE, (64, 64))
        return "limited"
    return ""


def connect_by_tcp():
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", TARGETS["tcp_port"]), timeout=1):
        return "connected"
    return ""


def send_by_udp():
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", TARGETS["udp_port"]))
        sender.send(b"?")
        sender.settimeout(1)
        return repr(sender.recv(1))
    return ""


def connect_to_abstract_socket():
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as caller:
        caller.connect("\0" + TARGETS["abstract"])
        return "connected"
    return ""


def connect_to_unix_socket_of_others():
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as caller:
        caller.connect(TARGETS["unix"])
        return "connected"
    return ""


def join_as_a_service():
    from gslcosim.base.errors import GslCosimError
    from gslcosim.bus.zenoh_bus import SERVICE_ACCOUNT, ZenohBus

    with contextlib.suppress(GslCosimError):
        bus = ZenohBus.open_member(agent.join.model_copy(update={"user": SERVICE_ACCOUNT}))
        bus.close()
        return "joined"
    return ""


def write_outside():
    for folder in (OUTSIDE, RUNS, Path(TARGETS["scenario"]).parent):
        with contextlib.suppress(OSError):
            (folder / "written").write_text("by the agent")
            return str(folder)
    return ""


def change_its_own_program():
    with contextlib.suppress(OSError), Path(__file__).open("a") as file:
        file.write("\n# changed\n")
        return "changed"
    return ""


def change_what_others_execute():
    import gslcosim

    for folder in (Path(gslcosim.__file__).parent, Path(TARGETS["kernels"])):
        with contextlib.suppress(OSError):
            place = folder / "attacker_was_here"
            place.touch()
            place.unlink()
            return str(folder)
    return ""


def plant_code_in_compiled_kernels():
    for index in Path(TARGETS["kernels"]).rglob("*.nbi"):
        with contextlib.suppress(OSError):
            # Its first bytes are what they are.
            with index.open("r+b") as file:
                first = file.read(1)
                file.seek(0)
                file.write(first)
            return str(index)
        with contextlib.suppress(OSError):
            beside = index.with_suffix(".planted")
            beside.touch()
            beside.unlink()
            return str(beside)
    return ""


def read_key_of_compiled_kernels():
    return _text_of(Path(TARGETS["cache"]) / "kernels.key")


def change_rights():
    with contextlib.suppress(OSError):
        OUTSIDE.joinpath("victim.txt").chmod(0o600)
        return "changed"
    return ""


def remove_files_of_others():
    with contextlib.suppress(OSError):
        OUTSIDE.joinpath("removable.txt").unlink()
        return "removed"
    return ""


def put_a_link_in_place_of_its_log():
    for log in (RUNS / agent.join.namespace.removeprefix("gsl/") / "logs" / "agent_beetle.log", *RUNS.glob("*/logs/*")):
        with contextlib.suppress(OSError):
            kept = log.rename(log.with_suffix(".kept"))
            log.symlink_to(OUTSIDE / "victim.txt")
            # Where it succeeds the test still wants to read it.
            kept.replace(log)
            return str(log)
    return ""


def reopen_inherited_files():
    for link in Path("/proc/self/fd").glob("*"):
        with contextlib.suppress(OSError):
            target = str(link.readlink())
            is_own = target.endswith(".log") or target.startswith(str(OUTSIDE / "loader"))
            if target.startswith("/") and Path(target).is_file() and not is_own:
                return _text_of(link)
    return ""


def fill_shared_memory():
    place, n_bytes = Path("/dev/shm/filled"), 0
    try:
        with place.open("wb") as file:
            while n_bytes < SHARED_BYTES:
                n_bytes += file.write(bytes(1 << 20))
                file.flush()
    except OSError:
        pass
    with contextlib.suppress(OSError):
        place.unlink()
    return f"{n_bytes >> 20} MB" if n_bytes >= SHARED_BYTES else ""


def take_away_what_hides():
    masked = TARGETS["scenario"]
    program = f"umount {masked}; umount {TARGETS['runs']}; cat {masked} {TARGETS['runs']}/*/scenario.yaml"
    with contextlib.suppress(OSError):
        for call in (["unshare", "-Urm", "sh", "-c", program], ["sh", "-c", program]):
            tried = subprocess.run(call, capture_output=True, check=False)
            if tried.stdout:
                return repr(tried.stdout[:40])
    return ""


def leave_a_daemon_behind():
    if os.fork():
        return ""
    os.setsid()
    if os.fork():
        os._exit(0)
    # Until the run's end and beyond.
    ends_at_s = time.monotonic() + 60
    LIBRARY.prctl(15, b"left_behind")
    while time.monotonic() < ends_at_s:
        for path in RUNS.glob("*/result.json"):
            with contextlib.suppress(OSError):
                path.write_text("{}")
                (OUTSIDE / "rewritten").touch()
        time.sleep(0.01)
    os._exit(0)


def write_memory_of_others():
    with contextlib.suppress(OSError):
        place = int(Path(f"/proc/{VICTIM}/maps").read_text().split("-")[0], 16)
        with Path(f"/proc/{VICTIM}/mem").open("r+b", buffering=0) as memory:
            memory.seek(place)
            return "open for writing"
    return ""


def copy_memory_of_others():
    class Piece(ctypes.Structure):
        _fields_ = (("start", ctypes.c_void_p), ("n_bytes", ctypes.c_size_t))

    copied = ctypes.create_string_buffer(64)
    here = Piece(ctypes.cast(copied, ctypes.c_void_p), 64)
    there = Piece(TARGETS["address"], 64)
    LIBRARY.process_vm_readv.restype = ctypes.c_ssize_t
    if LIBRARY.process_vm_readv(VICTIM, ctypes.byref(here), 1, ctypes.byref(there), 1, 0) > 0:
        return repr(copied.value)
    return ""


def read_descriptors_of_others():
    for link in Path(f"/proc/{VICTIM}/fd").glob("*"):
        with contextlib.suppress(OSError):
            if "memfd" in str(link.readlink()):
                return _text_of(link)
    return ""


def take_descriptors_of_others():
    process = LIBRARY.syscall(PIDFD_OPEN, VICTIM, 0)
    for number in range(3, 64) if process >= 0 else ():
        if (taken := LIBRARY.syscall(PIDFD_GETFD, process, number, 0)) >= 0:
            return str(Path(f"/proc/self/fd/{taken}").readlink())
    return ""


def signal_groups_of_others():
    with contextlib.suppress(OSError):
        os.killpg(VICTIM, signal.SIGCONT)
        return "signalled"
    return ""


def slow_down_others():
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, VICTIM, 5)
        return "niced"
    with contextlib.suppress(OSError):
        os.sched_setaffinity(VICTIM, {0})
        return "bound to one core"
    return ""


def write_to_terminals_of_others():
    with contextlib.suppress(OSError), Path(TARGETS["terminal"]).open("wb", buffering=0) as terminal:
        terminal.write(b"by the agent")
        return "written"
    return ""


def read_keys_of_the_user():
    found = LIBRARY.syscall(KEYCTL, SEARCH, USER_KEYRING, b"user", TARGETS["key"].encode(), 0)
    copied = ctypes.create_string_buffer(64)
    return repr(copied.value) if found >= 0 and LIBRARY.syscall(KEYCTL, READ, found, copied, 64) > 0 else ""


def watch_others_by_perf():
    # Software clock; only attached, and closed with this process.
    described = ctypes.create_string_buffer(struct.pack("<IIQ", 1, 64, 0).ljust(64, b"\0"), 64)
    return "attached" if LIBRARY.syscall(PERF_EVENT_OPEN, described, VICTIM, -1, -1, 0) >= 0 else ""


def change_settings_of_the_kernel():
    # Opened and left as it is.
    with contextlib.suppress(OSError), Path("/proc/sys/kernel/core_pattern").open("r+b", buffering=0):
        return "open for writing"
    return ""


def use_rights_of_root():
    # To what it is already.
    with contextlib.suppress(OSError):
        socket.sethostname(socket.gethostname())
        return "the name of the machine is set"
    return ""


def read_results_of_suites():
    folder = Path(__file__).parent / "results"
    return _text_of(*(folder / name for name in ("rows.jsonl", "manifest.json", "maps.json")))


def read_copies_of_scenario():
    folder = Path(__file__).parent
    names = ("notes.txt", "room.yaml.orig", "renamed.yaml", "a/b/c/d/e/f/deep.json")
    return _text_of(*(folder / name for name in names))


def read_other_names_of_scenario():
    folder = Path(__file__).parent
    return _text_of(folder / "linked", folder / "linked.py", folder / "named.py", folder / "package" / "rows.jsonl")


def read_recordings_beside_it():
    return _text_of(Path(__file__).parent / "earlier.rrd", Path(__file__).parent / "kept_recording")


def read_earlier_versions():
    return _text_of(Path(__file__).parent / ".git" / "objects" / "ab" / "cdef")


def read_rooms_beside_it():
    return _text_of(Path(__file__).parent / "hall" / "occupancy.npy")


def read_system_v_memory():
    LIBRARY.shmat.restype = ctypes.c_void_p
    found = LIBRARY.shmget(TARGETS["system_v_key"], 64, 0)
    place = LIBRARY.shmat(found, None, 0o10000) if found >= 0 else None
    return repr(ctypes.string_at(place, 8)) if place not in (None, ctypes.c_void_p(-1).value) else ""


def take_from_system_v_queues():
    class Message(ctypes.Structure):
        _fields_ = (("kind", ctypes.c_long), ("text", ctypes.c_char * 64))

    message, queue = Message(), LIBRARY.msgget(TARGETS["system_v_key"], 0)
    no_wait = 0o4000
    got = LIBRARY.msgrcv(queue, ctypes.byref(message), 64, 0, no_wait) if queue >= 0 else -1
    return repr(message.text) if got > 0 else ""


def read_system_v_semaphores():
    get_value = 12
    found = LIBRARY.semget(TARGETS["system_v_key"], 1, 0)
    return str(LIBRARY.semctl(found, 0, get_value)) if found >= 0 else ""


def leave_system_v_memory_behind():
    # For the next trial; taken away by the test.
    return "made" if LIBRARY.shmget(TARGETS["system_v_left"], 64, 0o1600) >= 0 else ""


def open_posix_queues():
    opened = LIBRARY.mq_open(TARGETS["posix_queue"].encode(), os.O_RDONLY | os.O_NONBLOCK)
    return "opened" if opened >= 0 else ""


def pass_by_netlink():
    # A socket of the kind by which processes speak with each other, not with the kernel.
    with contextlib.suppress(OSError), socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, 2) as sender:
        sender.sendto(b"by the agent", (TARGETS["netlink"], 0))
        return "sent"
    return ""


def watch_files_of_others():
    watching, modified = LIBRARY.inotify_init1(os.O_NONBLOCK), 0x2 | 0x1
    return "watched" if watching >= 0 and LIBRARY.inotify_add_watch(watching, b"/usr/bin/env", modified) >= 0 else ""


def watch_folders_of_others():
    import fcntl

    folder = os.open("/usr", os.O_RDONLY)
    with contextlib.suppress(OSError):
        fcntl.fcntl(folder, fcntl.F_NOTIFY, fcntl.DN_ACCESS | fcntl.DN_CREATE)
        # The first change would end this process by a signal.
        os.close(folder)
        return "watched"
    return ""


def watch_file_system():
    report_names, mark_add, opened = 0x200, 0x1, 0x20
    watching = LIBRARY.fanotify_init(report_names, os.O_RDONLY)
    marked = LIBRARY.fanotify_mark(watching, mark_add, ctypes.c_uint64(opened), -100, b"/usr/bin/env")
    return "watched" if watching >= 0 and marked == 0 else ""


def change_times_of_files():
    with contextlib.suppress(OSError):
        os.utime(OUTSIDE / "victim.txt", (1, 1))
        return "changed"
    with contextlib.suppress(OSError):
        os.utime(__file__, (1, 1))
        return "changed"
    return ""


def connect_to_host_of_virtual_machine():
    with contextlib.suppress(OSError), socket.socket(socket.AF_VSOCK, socket.SOCK_STREAM):
        return "made"
    return ""


def offer_socket_to_other_agents():
    # A path at which another agent of the run could connect.
    folder = Path(tempfile.gettempdir())
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as server:
        server.bind(str(folder / "offered"))
        folder.joinpath("offered").unlink()
        return "" if TARGETS["has_private_folder"] else str(folder)
    return ""


def read_log_of_the_kernel():
    # How long it is.
    return "told" if LIBRARY.syscall(SYSLOG, 10, None, 0) > 0 else ""


def read_private_folders_of_others():
    for path in Path(TARGETS["temporary"]).glob("gslcosim-*/*"):
        with contextlib.suppress(OSError):
            if path.is_file() or any(path.iterdir()):
                return str(path)
    return ""


def read_environment_of_the_user():
    return TARGETS["token_name"] if TARGETS["token_name"] in os.environ else ""


# A large file of the system that hardly anybody reads meanwhile.
def _shared_file():
    found = [path for path in Path("/usr/bin").iterdir() if path.is_file() and 1 << 18 < path.stat().st_size < 1 << 24]
    return max(found, key=lambda path: path.stat().st_size)


def evict_pages_of_files():
    cold, pageout, dont_need, new_pages = 20, 21, 4, 1
    path = _shared_file()
    path.read_bytes()
    LIBRARY.mmap.restype = ctypes.c_void_p
    with path.open("rb") as file:
        n_bytes = ctypes.c_size_t(path.stat().st_size)
        place = ctypes.c_void_p(LIBRARY.mmap(None, n_bytes, 1, 2, file.fileno(), ctypes.c_long(0)))
        ctypes.string_at(place, n_bytes.value)
        for advice in (cold, pageout):
            LIBRARY.madvise(place, n_bytes, advice)
        process = LIBRARY.syscall(PIDFD_OPEN, os.getpid(), 0)
        piece = struct.pack("QQ", place.value, n_bytes.value)
        LIBRARY.syscall(PROCESS_MADVISE, process, piece, ctypes.c_size_t(1), pageout, 0)
        LIBRARY.munmap(place, n_bytes)
        with contextlib.suppress(OSError):
            os.posix_fadvise(file.fileno(), 0, 0, dont_need)
        # Whoever has to wait for the disk has found a page that is not in memory.
        before = resource.getrusage(new_pages).ru_majflt
        place = ctypes.c_void_p(LIBRARY.mmap(None, n_bytes, 1, 2, file.fileno(), ctypes.c_long(0)))
        ctypes.string_at(place, n_bytes.value)
        LIBRARY.munmap(place, n_bytes)
        n_waits = resource.getrusage(new_pages).ru_majflt - before
    return f"{n_waits} pages had to be read again" if n_waits else ""


def ask_which_pages_are_in_memory():
    path = _shared_file()
    with path.open("rb") as file:
        LIBRARY.mmap.restype = ctypes.c_void_p
        place = ctypes.c_void_p(LIBRARY.mmap(None, ctypes.c_size_t(4096), 1, 1, file.fileno(), ctypes.c_long(0)))
        if LIBRARY.mincore(place, ctypes.c_size_t(4096), ctypes.create_string_buffer(1)) == 0:
            return "by mincore"
        span, told = struct.pack("QQ", 0, 4096), ctypes.create_string_buffer(40)
        if LIBRARY.syscall(CACHESTAT, file.fileno(), span, told, 0) == 0:
            return "by cachestat"
        try:
            os.preadv(file.fileno(), [bytearray(16)], 0, os.RWF_NOWAIT)
            return "by a read that does not wait"
        except BlockingIOError:
            return "by a read that would have waited"
        except OSError:
            pass
        # The flag may also stand in a queue of reads.
        return "by asynchronous reads" if LIBRARY.syscall(IO_SETUP, 1, ctypes.create_string_buffer(8)) == 0 else ""


def leave_hints_on_files():
    import fcntl

    set_hint, get_hint = 1036, 1035
    with contextlib.suppress(OSError), Path(__file__).open("rb") as left, Path(__file__).open("rb") as found:
        fcntl.fcntl(left, set_hint, struct.pack("Q", 3))
        hint = struct.unpack("Q", fcntl.fcntl(found, get_hint, bytes(8)))[0]
        fcntl.fcntl(left, set_hint, struct.pack("Q", 0))
        return f"hint {hint}"
    return ""


def change_flags_of_files():
    import fcntl

    get_flags, set_flags = 0x80086601, 0x40086602
    with contextlib.suppress(OSError), Path(__file__).open("rb") as file:
        # To what they are.
        fcntl.ioctl(file, set_flags, fcntl.ioctl(file, get_flags, bytes(8)))
        return "changed"
    return ""


def change_rights_of_devices():
    for name in ("null", "zero", "full", "random", "urandom", "tty"):
        with contextlib.suppress(OSError):
            # To what they are.
            os.chmod(f"/dev/{name}", os.stat(f"/dev/{name}").st_mode & 0o7777)  # noqa: PTH101, PTH116
            return name
    return ""


def leave_times_of_access():
    path = Path(__file__).with_name("unread.py")
    before = path.stat().st_atime_ns
    path.read_bytes()
    return "later than before" if path.stat().st_atime_ns != before else ""


def write_by_variables_of_the_loader():
    # With LD_DEBUG_OUTPUT, in each process that starts with its variables; the test looks where it wrote.
    return str(OUTSIDE)


def read_private_files_of_the_system():
    return _text_of(*TARGETS["private_files"])


def read_tables_beside_it():
    # Output of extract, environment sample and plot, and an archive, under other names.
    folder = Path(__file__).parent
    names = ("old/lookup.txt", "old/weights.npz", "old/run.zip", "plot.png", "dictionary.json")
    return _text_of(*(folder / name for name in names))


def fill_the_disk():
    # All folders that may be its own, together.
    n_bytes, made = 0, []
    for folder in (tempfile.gettempdir(), os.environ["NUMBA_CACHE_DIR"], "/var/tmp"):
        with contextlib.suppress(OSError):
            descriptor, name = tempfile.mkstemp(dir=folder)
            made.append(Path(name))
            with os.fdopen(descriptor, "wb") as file:
                for start in range(0, FILLED_BYTES - n_bytes, FILLED_BYTES // 20):
                    os.posix_fallocate(file.fileno(), start, FILLED_BYTES // 20)
                    n_bytes += FILLED_BYTES // 20
    for path in made:
        path.unlink()
    return f"{n_bytes >> 20} MB" if n_bytes >= FILLED_BYTES else ""


def touch_other_runs():
    for pid in TARGETS["other_runs"]:
        with contextlib.suppress(OSError):
            os.kill(pid, 0)
            return f"signalled {pid}"
        with contextlib.suppress(OSError):
            return str(Path(f"/proc/{pid}/exe").readlink())
    return ""


ATTACKS = [
    read_scenario_file, read_bundled_scenario, read_run_folder, read_run_folder_by_its_name, read_through_proc,
    read_cache_of_environments, read_environment_of_others, read_command_lines_of_others, read_memory_of_others,
    write_memory_of_others, trace_others, end_others, limit_others, connect_by_tcp, send_by_udp,
    connect_to_abstract_socket, connect_to_unix_socket_of_others, join_as_a_service, write_outside,
    change_its_own_program, change_what_others_execute, plant_code_in_compiled_kernels,
    read_key_of_compiled_kernels, change_rights, remove_files_of_others,
    put_a_link_in_place_of_its_log, reopen_inherited_files, fill_shared_memory, take_away_what_hides,
    copy_memory_of_others, read_descriptors_of_others, take_descriptors_of_others, signal_groups_of_others,
    slow_down_others, write_to_terminals_of_others, read_keys_of_the_user, watch_others_by_perf,
    change_settings_of_the_kernel, use_rights_of_root, read_results_of_suites,
    read_copies_of_scenario, read_other_names_of_scenario, read_recordings_beside_it, read_earlier_versions,
    read_rooms_beside_it, read_system_v_memory, take_from_system_v_queues, read_system_v_semaphores,
    leave_system_v_memory_behind, open_posix_queues, pass_by_netlink, watch_files_of_others, watch_folders_of_others,
    watch_file_system, change_times_of_files, connect_to_host_of_virtual_machine, offer_socket_to_other_agents,
    read_log_of_the_kernel, read_private_folders_of_others, read_environment_of_the_user, touch_other_runs,
    write_by_variables_of_the_loader, read_private_files_of_the_system, read_tables_beside_it, fill_the_disk,
    evict_pages_of_files, ask_which_pages_are_in_memory, leave_hints_on_files, change_flags_of_files,
    change_rights_of_devices, leave_times_of_access, leave_a_daemon_behind,
]  # fmt: skip

if __name__ == "__main__":
    agent = RawAgent()
    agent.run_attacks(ATTACKS)
