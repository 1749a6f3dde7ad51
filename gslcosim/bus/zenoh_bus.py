# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false
# pyright: reportUnknownLambdaType=false
"""Bus over Zenoh: a router embedded in the supervisor, a client session in every other process."""

import base64
import contextlib
import errno
import json
import os
import queue
import re
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import zenoh
import zenoh.handlers
from typing_extensions import override

from gslcosim.base.errors import (
    RESOURCE_ERRNOS,
    MachineError,
    SimulationFault,
    build_machine_error,
    build_process_error,
)
from gslcosim.base.thread_limit import reserve_session_threads
from gslcosim.bus.interface import (
    INHERITED_FILES,
    Bus,
    Certificate,
    JoinData,
    Mailbox,
    MessageHandler,
    QueryHandler,
    QueueMailbox,
)

SERVICE_ACCOUNT = "service"
_EXPECTED_SESSION = "a session that opens"
# Name of the class by which pyo3 reports a Rust panic; the class cannot be imported.
_PANIC_TYPE = "PanicException"
_UNIX_SOCKET = "unixsock-stream/"
# A router that answers may have been stopped during an attempt; one that refuses a password answers each time.
_MAX_ATTEMPTS = 3
# Limit of a service's attempts to reach the router, and delays of attempts to reach services that have not started.
MESH_LIMIT_MS = 2000
MESH_RETRY = {"period_init_ms": 10, "period_max_ms": 100, "period_increase_factor": 1.5}
# More than any reader's backlog: a full channel would stop the reception of the whole session.
MAILBOX_CAPACITY = 1 << 16
# Longer waits end by a thread with this period [s]; shorter ones poll.
MAILBOX_CHECK_PERIOD_S = 0.05
MAILBOX_POLL_PERIOD_S = 0.0005
# Default silence after which others give up a member elsewhere that hangs without its process having ended [ms].
LEASE_MS = 2500
# Tolerance of members elsewhere for a silent router, because the supervisor may be paused [ms].
ROUTER_LEASE_MS = 60_000
# The end or stop of processes of this machine is observed: their silence has no meaning.
WATCHED_LEASE_MS = 24 * 60 * 60 * 1000
# Wait of the router for a member that does not read, before it closes the link; longer than a process may be stopped.
# Other members wait meanwhile.
UNREAD_LIMIT_MS = 10_000
CLOSE_LIMIT_S = 5.0
# Segment of a key that no participant has.
WAKE_SEGMENT = "-"
# A callback waits until the interpreter's lock is released; Python's 5 ms would be the latency of a run.
SWITCH_INTERVAL_S = 0.0002


@dataclass(frozen=True, kw_only=True)
class AgentAccount:
    """The account of an agents' process, which can reach the keys of its agent and of `others` only."""

    agent: str
    password: str
    others: tuple[str, ...] = ()

    @property
    def user(self) -> str:
        """The account's name."""
        return f"agent_{self.agent}"


# A rule matches when its key includes the message's key, so an agent may subscribe to `**` and still receives only the
# messages that its egress rule allows.
def build_access_control(namespace: str, agents: list[AgentAccount]) -> dict[str, Any]:
    """Return the access rules of Zenoh's router: no limits for services, those of `AgentAccount` for agents."""
    rules: list[dict[str, Any]] = [
        {
            "id": "everything",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": [
                "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
                "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
            ],
            "key_exprs": ["**"],
        }
    ]  # fmt: skip
    subjects: list[dict[str, Any]] = [{"id": SERVICE_ACCOUNT, "usernames": [SERVICE_ACCOUNT]}]
    policies: list[dict[str, Any]] = [{"rules": ["everything"], "subjects": [SERVICE_ACCOUNT]}]
    for agent in agents:
        homes = [f"{namespace}/agents/{name}" for name in (agent.agent, *agent.others)]
        everything = [f"{home}/**" for home in homes]
        commands, tokens = [f"{home}/command" for home in homes], [f"{home}/alive" for home in homes]
        mine = [
            _build_rule(f"{agent.user}_hears", "egress", ["put", "delete", "reply"], everything),
            _build_rule(f"{agent.user}_asks", "ingress", ["declare_subscriber", "query"], ["**"]),
            _build_rule(f"{agent.user}_is_asked", "egress", ["declare_subscriber"], commands),
            _build_rule(f"{agent.user}_acts", "ingress", ["put"], commands),
            _build_rule(f"{agent.user}_lives", "ingress", ["liveliness_token"], tokens),
        ]
        rules += mine
        subjects.append({"id": agent.user, "usernames": [agent.user]})
        policies.append({"rules": [rule["id"] for rule in mine], "subjects": [agent.user]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _build_rule(rule_id: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": rule_id, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}


def open_session(config: zenoh.Config, *, first_member: zenoh.Config | None = None) -> zenoh.Session:
    """Open a session.

    Args:
        first_member: Configuration of a member that joins a router and leaves it at once where the limit on threads is
            low: a router starts its reading threads only with its first member, when other sessions may have used up
            the limit.
    """
    try:
        # Zenoh's runtime panics where it cannot start a thread.
        with reserve_session_threads() as is_low:
            session = zenoh.open(config)
            if is_low and first_member is not None:
                zenoh.open(first_member).close()
            return session
    except zenoh.ZError as error:
        found = re.search(r"\(os error (\d+)\)", str(error))
        number = int(found[1]) if found is not None else 0
        if number == errno.EAGAIN:
            raise build_process_error() from error
        if number in RESOURCE_ERRNOS:
            raise build_machine_error(OSError(number, os.strerror(number)), "zenoh", _EXPECTED_SESSION) from error
        raise
    except BaseException as error:
        if type(error).__name__ != _PANIC_TYPE:
            raise
        if f"(os error {errno.EAGAIN})" in str(error):
            raise build_process_error() from error
        raise MachineError(
            f"zenoh: expected {_EXPECTED_SESSION}, was {error}. Raise the limits on open files (ulimit -n) and on "
            "processes (ulimit -u), or close programs."
        ) from error


def open_with_retries(open_once: Callable[[], zenoh.Session], endpoint: str) -> zenoh.Session:
    """Open a session to this machine's router; wait for a stopped router for an unlimited time.

    Zenoh gives up an attempt after seconds, with the same error for a stopped router and a refused password.
    """
    for _ in range(_MAX_ATTEMPTS - 1):
        try:
            return open_once()
        except zenoh.ZError:
            if not wait_for_router(endpoint):
                raise
    return open_once()


def wait_for_router(endpoint: str) -> bool:
    """Wait until the process that listens at a unix socket reads from it; return False where none listens.

    The kernel accepts connections for a stopped process, which reads the end of this one when it continues, and closes
    it.
    """
    if not endpoint.startswith(_UNIX_SOCKET):
        return False
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            probe.connect(endpoint.removeprefix(_UNIX_SOCKET))
            probe.shutdown(socket.SHUT_WR)
            while probe.recv(4096):
                pass
    except ConnectionResetError:
        return True
    except OSError:
        return False
    return True


def set_unread_limit(config: zenoh.Config, limit_ms: int) -> None:
    """Close the link of a member that has read nothing for this time [ms]."""
    config.insert_json5("transport/link/tx/queue/congestion_control/block/wait_before_close", str(limit_ms * 1000))


def is_mesh_possible() -> bool:
    """Return whether the system has files without a name, in which agents of the same user cannot read accounts."""
    return hasattr(os, "memfd_create")


@contextlib.contextmanager
def peer_session(config: zenoh.Config, join: JoinData) -> Generator[None]:
    """Configure a session as a peer of the other services; it has to be opened within the block.

    A router forwards nothing between peers, so each message reaches each reader once. Peers admit each other by the
    same account as the router. Without a mesh nothing is configured.
    """
    mesh = join.mesh
    if mesh is None:
        yield
        return
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", json.dumps([mesh.listen]))
    endpoints = [f"{join.endpoint}#exit_on_failure=true", *(f"{other}#exit_on_failure=false" for other in mesh.connect)]
    config.insert_json5("connect/endpoints", json.dumps(endpoints))
    config.insert_json5("connect/timeout_ms", str(MESH_LIMIT_MS))
    config.insert_json5("connect/retry", json.dumps(MESH_RETRY))
    accounts = os.memfd_create("accounts")
    try:
        os.write(accounts, f"{join.user}:{join.password}\n".encode())
        config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(INHERITED_FILES / str(accounts))))
        yield
    finally:
        os.close(accounts)


def is_router_lost(event: zenoh.TransportEvent) -> bool:
    """Return whether the link to the router has ended; links to peers come and go."""
    return event.kind == zenoh.SampleKind.DELETE and event.transport.whatami == zenoh.WhatAmI.ROUTER


class ZenohMailbox(Mailbox):
    """Mailbox of a session; received messages and those of `put` have no order among each other.

    Args:
        prefix: The namespace with its slash, removed from keys.
        wake_key: A key that matches `key` and that no other member uses.
    """

    def __init__(self, session: zenoh.Session, prefix: str, key: str, wake_key: str) -> None:
        self._prefix = prefix
        self._wake_key = wake_key
        self._put: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        channel: Any = zenoh.handlers.FifoChannel(MAILBOX_CAPACITY)
        self._channel: Any = session.declare_subscriber(key, channel)
        self._waker: Any = session.declare_publisher(wake_key, allowed_destination=zenoh.Locality.SESSION_LOCAL)
        self._is_waiting = False
        self._deadline_s: float | None = None
        self._watch: threading.Thread | None = None

    @override
    def put(self, key: str, payload: bytes) -> None:
        self._put.put((key, payload))
        # A reader sets this before it looks for messages.
        if self._is_waiting:
            self._waker.put(b"")

    @override
    def get(self, timeout_s: float | None = None) -> tuple[str, bytes]:
        if timeout_s is not None and timeout_s < MAILBOX_CHECK_PERIOD_S:
            return self._poll(timeout_s)
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        self._is_waiting = True
        try:
            while (found := self.get_nowait()) is None:
                if deadline_s is not None and time.monotonic() >= deadline_s:
                    raise queue.Empty
                self._deadline_s = deadline_s
                if deadline_s is not None and self._watch is None:
                    self._watch = threading.Thread(target=self._wake_at_deadline, daemon=True)
                    self._watch.start()
                if (found := self._decode(self._channel.recv())) is not None:
                    break
            return found
        finally:
            self._is_waiting = False
            self._deadline_s = None

    @override
    def get_nowait(self) -> tuple[str, bytes] | None:
        if not self._put.empty():
            return self._put.get()
        while (sample := self._channel.try_recv()) is not None:
            if (found := self._decode(sample)) is not None:
                return found
        return None

    def _poll(self, timeout_s: float) -> tuple[str, bytes]:
        deadline_s = time.monotonic() + timeout_s
        while (found := self.get_nowait()) is None:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise queue.Empty
            time.sleep(min(left_s, MAILBOX_POLL_PERIOD_S))
        return found

    def _decode(self, sample: zenoh.Sample) -> tuple[str, bytes] | None:
        key = str(sample.key_expr).removeprefix(self._prefix)
        return None if key == self._wake_key else (key, sample.payload.to_bytes())

    def _wake_at_deadline(self) -> None:
        while True:
            time.sleep(MAILBOX_CHECK_PERIOD_S)
            deadline_s = self._deadline_s
            if deadline_s is not None and time.monotonic() >= deadline_s:
                try:
                    self._waker.put(b"")
                except zenoh.ZError:
                    return


class ZenohBus(Bus):
    """A Zenoh session as a `Bus`.

    Zenoh's own queues are bounded and drop or disconnect when full; all handlers here must only enqueue.
    """

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._session = session
        self._prefix = f"{namespace}/"
        self._publishers: dict[tuple[str, bool], zenoh.Publisher] = {}
        self._held: list[Any] = []  # Zenoh undeclares objects without a reference
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    @classmethod
    def open_member(cls, join: JoinData) -> Self:
        """Connect a process to the run's router."""
        elsewhere_ms = LEASE_MS if join.lease_s is None else round(1000 * join.lease_s)
        config = build_session_config(join.namespace, lease_ms=WATCHED_LEASE_MS if join.is_watched else elsewhere_ms)
        if join.is_watched or join.lease_s is not None:
            set_unread_limit(config, WATCHED_LEASE_MS if join.is_watched else elsewhere_ms)
        if not join.is_watched:
            _enable_compression(config)
        _insert_client(config, join.endpoint, join.user, join.password)
        if join.tls_root_ca is not None:
            _insert_base64(config, "root_ca_certificate_base64", join.tls_root_ca)
        if join.tls_client_certificate is not None and join.tls_client_key is not None:
            config.insert_json5("transport/link/tls/enable_mtls", "true")
            _insert_base64(config, "connect_certificate_base64", join.tls_client_certificate)
            _insert_base64(config, "connect_private_key_base64", join.tls_client_key)
        # A watched process ends with the supervisor, so a silent router is a stopped one.
        endpoint = join.endpoint if join.is_watched else ""
        try:
            with peer_session(config, join):
                session = open_with_retries(lambda: open_session(config), endpoint)
                return cls(session, join.namespace)
        except zenoh.ZError as error:
            account = f"user {join.user!r} and its password"
            refused = f"{account}, or the client certificate, were" if join.needs_tls_client else f"{account} were"
            raise SimulationFault(
                f"{join.name}: expected the run's router at {join.endpoint}, could not join it. Either the run has "
                f"ended, or {refused} refused. ({error})"
            ) from error

    @classmethod
    def open_router(
        cls,
        *,
        endpoints: Iterable[str],
        namespace: str,
        service_password: str,
        agents: Iterable[AgentAccount],
        secrets_dir: Path,
        tls: Certificate | None = None,
        lease_s: float = 0.0,
    ) -> Self:
        """Open the run's router, with one account for the services and one for each process of agents.

        An agents' account is confined to `agents/<name>/**` of its agents: it may write their commands and their
        liveliness tokens there and read the rest of it; everything else is denied in both directions.
        A member that is cut off keeps its place for `lease_s`, the longest lease of members elsewhere.
        """
        agents, endpoints = list(agents), list(endpoints)
        accounts = secrets_dir / "accounts"
        accounts.touch(mode=0o600)
        lines = [f"{SERVICE_ACCOUNT}:{service_password}", *(f"{a.user}:{a.password}" for a in agents)]
        accounts.write_text("\n".join(lines) + "\n")
        is_local = all(endpoint.startswith("unixsock-stream/") for endpoint in endpoints)
        config = build_session_config(namespace, lease_ms=WATCHED_LEASE_MS if is_local else ROUTER_LEASE_MS)
        set_unread_limit(config, max(UNREAD_LIMIT_MS, round(1000 * lease_s)))
        if not is_local:
            _enable_compression(config)
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps(endpoints))
        if tls is not None:
            config.insert_json5("transport/link/tls/listen_certificate", json.dumps(str(tls.certificate)))
            config.insert_json5("transport/link/tls/listen_private_key", json.dumps(str(tls.private_key)))
            if tls.client_ca is not None:
                config.insert_json5("transport/link/tls/enable_mtls", "true")
                config.insert_json5("transport/link/tls/root_ca_certificate", json.dumps(str(tls.client_ca)))
        config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(accounts)))
        config.insert_json5("transport/auth/usrpwd/user", json.dumps(SERVICE_ACCOUNT))
        config.insert_json5("transport/auth/usrpwd/password", json.dumps(service_password))
        config.insert_json5("access_control", json.dumps(build_access_control(namespace, agents)))
        first_member = None
        if is_local and endpoints:
            first_member = build_session_config(namespace)
            _insert_client(first_member, endpoints[0], SERVICE_ACCOUNT, service_password)
        try:
            return cls(open_session(config, first_member=first_member), namespace)
        except zenoh.ZError as error:
            raise SimulationFault(f"router: expected to listen on {endpoints}, could not: {error}") from error
        finally:
            # The router has read it; agents of the same user could read it, too.
            accounts.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @override
    def publish(self, key: str, payload: bytes, *, encoding: str = "", urgent: bool = False) -> None:
        publisher = self._publishers.get((key, urgent))
        if publisher is None:
            publisher = self._session.declare_publisher(
                key,
                encoding=zenoh.Encoding(encoding or "application/msgpack"),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=urgent,
            )
            self._publishers[key, urgent] = publisher
        publisher.put(payload)

    @override
    def subscribe(
        self,
        key: str,
        handler: MessageHandler,
        *,
        max_bytes: int | None = None,
        on_longer: Callable[[str, int], None] = lambda _key, _n_bytes: None,
    ) -> None:
        """Call `handler(key, payload)` for each message whose key matches.

        A payload of more than `max_bytes` is not even copied: `on_longer(key, n_bytes)` is called instead.
        """

        def on_sample(sample: zenoh.Sample) -> None:
            n_bytes = len(sample.payload)
            if max_bytes is not None and n_bytes > max_bytes:
                on_longer(self._relative(sample.key_expr), n_bytes)
            else:
                handler(self._relative(sample.key_expr), sample.payload.to_bytes())

        # Indirect: the network's thread must not wait for the interpreter, or the router forwards nothing meanwhile.
        callback: Any = zenoh.handlers.Callback(on_sample, indirect=True)
        self._held.append(self._session.declare_subscriber(key, callback))

    @override
    def mailbox(self, key: str | None = None) -> Mailbox:
        if key is None:
            return QueueMailbox()
        return ZenohMailbox(self._session, self._prefix, key, key.replace("$*", "").replace("*", WAKE_SEGMENT))

    @override
    def answer(self, key: str, answerer: QueryHandler) -> None:
        def reply(query: zenoh.Query) -> None:
            with query:
                question = query.payload.to_bytes() if query.payload else b""
                for payload in answerer(question):
                    query.reply(query.key_expr, payload)

        self._held.append(self._session.declare_queryable(key, reply))

    @override
    def ask(self, key: str, payload: bytes, handler: MessageHandler) -> None:
        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                handler(self._relative(reply.ok.key_expr), reply.ok.payload.to_bytes())

        # All replies of one member to a query count, as each is another message.
        every, each = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
        try:
            self._session.get(key, on_reply, payload=payload, target=every, consolidation=each)
        except zenoh.ZError:
            # A thread that inspects a run may send a query while the session is closed.
            if not self._session.is_closed():
                raise

    @override
    def declare_alive(self, key: str) -> None:
        self._tokens[key] = self._session.liveliness().declare_token(key)

    @override
    def withdraw_alive(self, key: str) -> None:
        self._tokens.pop(key).undeclare()

    @override
    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> None:
        self._held.append(
            self._session.liveliness().declare_subscriber(
                key,
                lambda sample: handler(self._relative(sample.key_expr), sample.kind == zenoh.SampleKind.PUT),
                history=True,
            )
        )

    def on_disconnect(self, handler: Callable[[], None]) -> None:
        """Call `handler()` when the link to the router is lost."""
        self._held.append(
            self._session.info.declare_transport_events_listener(
                lambda event: handler() if is_router_lost(event) else None
            )
        )

    @override
    def close(self) -> None:
        """End the session. It can block for seconds on a bad link, so the wait is limited."""
        if self._session.is_closed():
            return

        def close_quietly() -> None:
            with contextlib.suppress(zenoh.ZError):
                self._session.close()

        closing = threading.Thread(target=close_quietly, daemon=True)
        try:
            closing.start()
        except RuntimeError:
            # No memory for a thread: the session ends with the process.
            return
        closing.join(CLOSE_LIMIT_S)

    def _relative(self, key: object) -> str:
        return str(key).removeprefix(self._prefix)


def generate_password() -> str:
    """Return a fresh random password; it has no influence on a run's results."""
    return secrets.token_urlsafe(18)


def build_session_config(namespace: str | None, *, lease_ms: int = LEASE_MS) -> zenoh.Config:
    """Return the common configuration of all sessions of a run; without a namespace keys are absolute.

    Args:
        lease_ms: Silence of the session after which the other side gives it up; each side states its own.
    """
    # Multicast and gossip off: runs never meet. Shared memory off: it drops messages on a loaded machine.
    config = zenoh.Config()
    if namespace is not None:
        config.insert_json5("namespace", json.dumps(namespace))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("scouting/delay", "0")
    config.insert_json5("timestamping/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    config.insert_json5("transport/link/tx/lease", str(lease_ms))
    config.insert_json5("transport/link/tx/keep_alive", "4")
    return config


def _insert_client(config: zenoh.Config, endpoint: str, user: str, password: str) -> None:
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("transport/auth/usrpwd/user", json.dumps(user))
    config.insert_json5("transport/auth/usrpwd/password", json.dumps(password))


# Only on links between machines, where keys of messages repeat.
def _enable_compression(config: zenoh.Config) -> None:
    config.insert_json5("transport/unicast/compression/enabled", "true")


def _insert_base64(config: zenoh.Config, key: str, pem: str) -> None:
    config.insert_json5(f"transport/link/tls/{key}", json.dumps(base64.b64encode(pem.encode()).decode()))
