"""Interface of all transports, and the data with which a process joins a run."""

import json
import os
import queue
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Protocol

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, ValidationError
from typing_extensions import override

from gslcosim.base.errors import UsageError
from gslcosim.base.spawn import open_memory_file

JOIN_VARIABLE = "GSLCOSIM_JOIN"
# Agents of a process that joins no bus; the gateway's address, and the password there.
AGENT_VARIABLE = "GSLCOSIM_AGENT"
GATEWAY_VARIABLE = "GSLCOSIM_GATEWAY"
TOKEN_VARIABLE = "GSLCOSIM_TOKEN"
# Variables in the environment of a process of a run.
JOIN_VARIABLES = (JOIN_VARIABLE, AGENT_VARIABLE, GATEWAY_VARIABLE, TOKEN_VARIABLE)
JOIN_FILE_WAIT_S = 120.0
# Folder in which Linux names the open files of a process.
INHERITED_FILES = Path("/proc/self/fd")

# A join file comes from another host: its contents end up in the configuration of the bus, in lines of accounts, and on
# the terminal. Long texts have a maximum length beside their pattern: in it, it would take megabytes in each process.
MAX_JOIN_FILE_BYTES = 1 << 20
_MEMBER = r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}"
_MAX_PATH = 4096
MemberName = Annotated[str, StringConstraints(pattern=rf"^{_MEMBER}$")]
# Services that share a process join as one, under all their names.
ProcessName = Annotated[str, StringConstraints(max_length=8192, pattern=rf"^{_MEMBER}(\+{_MEMBER})*$")]
Endpoint = Annotated[
    str,
    StringConstraints(
        max_length=len("unixsock-stream/") + _MAX_PATH,
        pattern=r"^((tcp|tls)/[A-Za-z0-9_.:%\[\]-]{1,300}(\?[A-Za-z0-9=;_-]{0,100})?|unixsock-stream/[^#?\x00-\x1f]+)$",
    ),
]
Namespace = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.-]{1,200}(/[A-Za-z0-9_.-]{1,200}){0,9}$")]
Secret = Annotated[str, StringConstraints(pattern=r"^[ -~]{1,200}$")]
PemText = Annotated[str, StringConstraints(max_length=1 << 18)]
MessageHandler = Callable[[str, bytes], None]
QueryHandler = Callable[[bytes], list[bytes]]


# Patterns match UTF-8 text only, which file names need not be.
def _check_path(path: str) -> str:
    if not 0 < len(path) <= _MAX_PATH or "\x00" in path:
        raise ValueError(f"expected a path of 1 to {_MAX_PATH} characters, none of them NUL")
    return path


PathText = Annotated[str, AfterValidator(_check_path)]


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """A TLS certificate and its private key, PEM files: the router's, or a member's.

    Only the router has the other two. `ca` vouches for its certificate; absent: the certificate vouches for itself.
    `client_ca` vouches for the members that may join; absent: name and password suffice.
    """

    certificate: Path
    private_key: Path
    ca: Path | None = None
    client_ca: Path | None = None


class Mesh(BaseModel):
    """Direct links between services of one host: the address to listen at, and those to connect to."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    listen: Endpoint
    connect: Annotated[tuple[Endpoint, ...], Field(max_length=1000)]


class JoinData(BaseModel):
    """Data with which a process joins a run: endpoint, name, account and namespace.

    `run_dir` is given to services only, never to agents. `tls_root_ca` is the PEM text of the certificate that vouches
    for the router, for endpoints that begin with `tls/`. `agents` names the agents of the process where there are
    several; otherwise it is the one of its `name`. `is_watched` means that the supervisor observes whether the process
    ends or is stopped, so that silence need not be interpreted. Other processes are given up after `lease_s` [s] of
    silence. `window_ticks` is given to services only, where it is not the default. `mesh` is given to services that
    share the router's host.
    `needs_tls_client` means that the router requires a client certificate; `tls_client_certificate` and
    `tls_client_key` are PEM texts that the joining host has added.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: ProcessName
    endpoint: Endpoint
    namespace: Namespace
    user: MemberName
    password: Secret
    run_dir: PathText | None = None
    tls_root_ca: PemText | None = None
    agents: Annotated[tuple[MemberName, ...], Field(max_length=1000)] | None = None
    is_watched: bool = False
    lease_s: Annotated[float, Field(gt=0, le=86_400)] | None = None
    window_ticks: Annotated[int, Field(ge=1, le=1 << 20)] | None = None
    mesh: Mesh | None = None
    needs_tls_client: bool = False
    tls_client_certificate: PemText | None = None
    tls_client_key: PemText | None = None

    @classmethod
    def from_environment(cls) -> "JoinData":
        """Return the join data from the environment variable `GSLCOSIM_JOIN`: JSON, or the path of a file with it.

        A missing file is waited for, so that processes on several hosts may start in any order. An inherited one,
        `/proc/self/fd/N`, is closed after it has been read.
        """
        text = os.environ.get(JOIN_VARIABLE, "")
        if not text:
            raise UsageError(
                f"{JOIN_VARIABLE}: expected JSON with name, endpoint, namespace, user and password, or a file that "
                "holds it; it is not set. `gslcosim up` sets it for the processes it starts."
            )
        if not text.lstrip().startswith("{"):
            text = read_join_file(Path(text), place=JOIN_VARIABLE)
        return cls.from_text(text, place=JOIN_VARIABLE)

    def hand_over(self) -> tuple[dict[str, str], tuple[int, ...]]:
        """Return the variables with which a child process joins, and the descriptors that it inherits.

        The join data are a file in memory where the system names inherited files: the environment of a process can be
        read by other processes of its user.
        """
        text = self.model_dump_json(exclude_none=True)
        if not INHERITED_FILES.is_dir():
            return {JOIN_VARIABLE: text}, ()
        descriptor = open_memory_file(text.encode())
        return {JOIN_VARIABLE: str(INHERITED_FILES / str(descriptor))}, (descriptor,)

    @classmethod
    def from_text(cls, text: str, *, place: str) -> "JoinData":
        """Return the join data in a JSON text."""
        try:
            return cls.model_validate(json.loads(text))
        except (ValueError, RecursionError) as error:
            raise UsageError(f"{place}: expected JSON as `gslcosim up` writes it; {describe_problem(error)}") from error


def describe_problem(error: Exception) -> str:
    """Return the problem of join data, without their secrets."""
    if not isinstance(error, ValidationError):
        return str(error)[:300]
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    return f"{'.'.join(str(part)[:80] for part in first['loc'])}: {first['msg'][:300]}"


def read_join_file(path: Path, *, place: str, wait_s: float = JOIN_FILE_WAIT_S) -> str:
    """Return the contents of a file with join data; a missing file is waited for."""
    deadline = time.monotonic() + wait_s
    while not path.exists():
        if time.monotonic() > deadline:
            within = f" within {wait_s:g} s" if wait_s else ""
            raise UsageError(f"{place}: expected a file{within}, found none.\nFile: {path}")
        time.sleep(0.05)
    text = _read_regular(path, place)
    if path.parent == INHERITED_FILES:
        # A closed file cannot be read by observers of this process.
        with suppress(OSError):
            os.close(int(path.name))
    return text


# Opening a pipe would block, and reading a device would never end.
def _read_regular(path: Path, place: str) -> str:
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(descriptor, encoding="utf-8") as file:
            if stat.S_ISREG(os.fstat(descriptor).st_mode):
                text = file.read(MAX_JOIN_FILE_BYTES + 1)
                if len(text) <= MAX_JOIN_FILE_BYTES:
                    return text
    except (OSError, ValueError) as error:
        raise UsageError(f"{place}: expected a file that can be read, could not ({error}).\nFile: {path}") from error
    raise UsageError(
        f"{place}: expected a regular file of at most {MAX_JOIN_FILE_BYTES} bytes, was another.\nFile: {path}"
    )


class Mailbox(Protocol):
    """Messages for one thread of a member, from any sender: the transport, or other threads."""

    def put(self, key: str, payload: bytes) -> None:
        """Add a message; may be called on any thread."""
        ...

    def get(self, timeout_s: float | None = None) -> tuple[str, bytes]:
        """Return the next message as (key, payload), and wait for it.

        Args:
            timeout_s: Limit of the wait [s]; absent: none.
        """
        ...

    def get_nowait(self) -> tuple[str, bytes] | None:
        """Return the next message, or None where there is none."""
        ...


class Bus(Protocol):
    """One member's connection to a run. Keys are relative to the run's namespace.

    Handlers run on a thread of the transport: they only enqueue.
    """

    def publish(self, key: str, payload: bytes, *, encoding: str = "", urgent: bool = False) -> None:
        """Send bytes to all subscribers of a key; an `urgent` message is not held back for batching."""
        ...

    def subscribe(self, key: str, handler: MessageHandler) -> None:
        """Call `handler(key, payload)` for each message whose key matches (`*` one segment, `**` any)."""
        ...

    def mailbox(self, key: str | None = None) -> Mailbox:
        """Return a mailbox for the messages whose key matches (`$*` also matches any part of a segment)."""
        ...

    def answer(self, key: str, answerer: QueryHandler) -> None:
        """Answer each query of a key with a list of payloads."""
        ...

    def ask(self, key: str, payload: bytes, handler: MessageHandler) -> None:
        """Send a query to a key; each answer goes to `handler`. No answer is not an error."""
        ...

    def declare_alive(self, key: str) -> None:
        """Publish a liveliness token until it is withdrawn or this connection ends."""
        ...

    def withdraw_alive(self, key: str) -> None:
        """Withdraw a liveliness token of this connection."""
        ...

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Call `handler(key, is_alive)` for each token that is there, appears or vanishes."""
        ...

    def close(self) -> None:
        """End the connection; further calls do nothing."""
        ...


class QueueMailbox(Mailbox):
    """Mailbox of one process, without a transport."""

    def __init__(self) -> None:
        self._messages: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()

    @override
    def put(self, key: str, payload: bytes) -> None:
        self._messages.put((key, payload))

    @override
    def get(self, timeout_s: float | None = None) -> tuple[str, bytes]:
        return self._messages.get(timeout=timeout_s)

    @override
    def get_nowait(self) -> tuple[str, bytes] | None:
        try:
            return self._messages.get_nowait()
        except queue.Empty:
            return None
